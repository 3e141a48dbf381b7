// SIM's own motion: gyro bias and yaw, encoder counts, speed, dead reckoning.
#pragma once
#include <stdint.h>

#include "../config.h"
#include "../hal/hal.h"
#include "tilt.h"
#include "wall_heading.h"

namespace core {

// Yaw from a biased gyro. The bias is a scalar Kalman filter (Kalman 1960): it walks while the robot drives and is
// measured by every sample of a standing robot. Its gain is 1/n after n samples of standing and at least 1/256.
class Gyro {
 public:
  Gyro();
  // One sample, `dt_us` after the one before; `still`: motors off and no tick for a while
  void sample(int16_t raw, uint32_t dt_us, bool still);
  // What else is known of its drift
  void correct(const Drift& drift);
  // (rad/s)^2
  float bias_variance() const;
  bool calibrated() const { return calibrated_; }
  int32_t yaw_cdeg() const;
  int32_t rate_cdps() const;

 private:
  void calibrate(int16_t raw, bool still);
  void track_bias(int32_t innovation_q16);
  void turn(int64_t angle);
  bool calibrated_;
  uint16_t boot_count_;
  int32_t boot_sum_;
  int16_t boot_low_, boot_high_;
  int32_t bias_q16_;      // counts
  uint32_t variance_q16_; // of the bias, in variances of one sample
  int32_t rate_q16_;      // counts, bias removed
  int64_t yaw_;           // counts * 2^8 * us
};

class Odometry {
 public:
  Odometry();
  // Every control tick
  void update(hal::Hal& hardware, uint32_t now_us, bool motors_off);
  // A new reading of the left or right sonar, 0 = nothing heard
  void hear_wall(bool right, uint16_t range_mm) { gyro_.correct(walls_.hear(right, range_mm)); }
  // How much of the yaw the walls told, and not the gyro
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
  int32_t last_yaw_cdeg_;
  int64_t x_nm_, y_nm_;
  uint16_t still_ms_, imu_silent_ms_;
  bool motors_off_, first_;
};

}  // namespace core
