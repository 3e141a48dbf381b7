// SIM's own motion: gyro bias and yaw, encoder counts, speed, dead reckoning.
#pragma once
#include <stdint.h>

#include "../config.h"
#include "../hal/hal.h"
#include "tilt.h"
#include "wall_heading.h"

namespace core {

// Yaw from a biased gyro: a Kalman filter (Kalman 1960) over both. The bias walks while the robot drives and is measured
// by every sample of a standing robot, with a gain of 1/n after n samples and at least 1/256; where it went tells what
// the yaw lost on the way. A stand that shows another bias than it can have wandered to is none: the wheels stay, but
// something turns the robot.
class Gyro {
 public:
  Gyro();
  // One sample, `dt_us` after the one before; `still`: motors off and no tick for a while
  void sample(int16_t raw, uint32_t dt_us, bool still);
  // (rad/s)^2
  float bias_variance() const;
  bool calibrated() const { return calibrated_; }
  // In a stand that is none
  bool turned() const { return turned_; }
  int32_t yaw_cdeg() const;
  int32_t rate_cdps() const;

 private:
  void calibrate(int16_t raw, bool still);
  void track_bias();
  bool wandered_too_far() const;
  void turn(int64_t angle);
  bool calibrated_;
  uint16_t boot_count_;
  int32_t boot_sum_;
  int16_t boot_low_, boot_high_;
  struct Learned {
    int32_t bias_q16;       // counts
    uint32_t variance_q16;  // of the bias, in variances of one sample
    float with_yaw_s;       // covariance of yaw and bias, in the same
    int64_t yaw;            // counts * 2^8 * us
  };
  Learned now_, before_;  // what would be known without this standstill
  bool turned_;
  int32_t rate_q16_;      // counts, bias removed
};

class Odometry {
 public:
  Odometry();
  // Every control tick
  void update(hal::Hal& hardware, uint32_t now_us, bool motors_off);
  // A new reading of the left or right sonar, 0 = no echo
  void hear_wall(bool right, uint16_t range_mm) { walls_.hear(right, range_mm); }
  // The yaw measured by gyro and walls, and the part of it by walls
  int32_t yaw_cdeg() const;
  int32_t yaw_by_walls_cdeg() const { return walls_.yaw_cdeg(); }
  const Gyro& gyro() const { return gyro_; }
  const Tilt& tilt() const { return tilt_; }
  bool imu_silent() const { return imu_silent_ms_ >= config::kImuSilent_ms; }
  bool standing() const { return still_ms_ >= config::kStandstill_ms && motors_off_; }
  int32_t ticks_left() const { return left_; }
  int32_t ticks_right() const { return right_; }
  int32_t x_mm() const { return static_cast<int32_t>(x_nm_ / 1000000); }
  int32_t y_mm() const { return static_cast<int32_t>(y_nm_ / 1000000); }
  // Over the last 40 ms, for the wheel controllers
  int32_t wheel_speed_q8(bool right) const;
  // Over the last 100 ms, forwards, for people and the report
  int32_t speed_mm_s() const;

 private:
  int32_t window_speed_q8(int32_t ticks, uint8_t back) const;
  static const uint8_t kHistory = 16;
  Gyro gyro_;
  Tilt tilt_;
  WallHeading walls_;
  int32_t left_, right_;
  int32_t history_left_[kHistory], history_right_[kHistory];
  uint32_t history_us_[kHistory];
  uint8_t head_;
  uint32_t last_us_;
  int32_t last_gyro_cdeg_, last_yaw_cdeg_;
  int64_t x_nm_, y_nm_;
  uint16_t still_ms_, imu_silent_ms_;
  bool motors_off_, first_;
};

}  // namespace core
