// Heading by walls: how the readings of a side sonar change beside a straight wall shows how the gyro drifts.
#pragma once
#include <stdint.h>

#include "../config.h"

namespace core {

struct Drift {
  float yaw_rad;     // to be added to the yaw
  float rate_rad_s;  // to be added to the yaw rate
};

// Extended Kalman filter (Kalman 1960) over the errors of yaw and gyro bias, and per side over distance and slant of
// the wall. Nobody knows a wall's slant when it begins: it is learned while the heading is still good, so that a wall
// tells of changes only. Readings are steps of an inch, taken as intervals: the Gaussian that fits the moments of the
// density cut to the interval (Curry, "Estimation and control with quantized measurements", MIT Press 1970).
// A wall that would need a gyro which drifts faster than gyros do is not straight: all it said since the last
// standstill is taken back, and until the next one walls are not asked any more.
class WallHeading {
 public:
  WallHeading();
  // The robot stands: the variance, (rad/s)^2, with which the gyro's bias is known now, and what that told of its yaw
  void stand(float bias_variance, int32_t told_cdeg);
  // The robot moved, by the ticks of both wheels and the gyro
  void move(uint32_t dt_us, int32_t ticks, int32_t turn_cdeg);
  // A new reading of the left or right sonar, 0 = no echo
  void hear(bool right, uint16_t range_mm);
  // How much of the yaw is from them, since power-on
  int32_t yaw_cdeg() const;

 private:
  enum State : uint8_t { kYaw, kBias, kWalls, kStates = 6 };  // of a wall: distance, then slant
  struct Wall {
    bool known;
    float distance_m;
    float angle_rad;      // of the heading to the wall
    float followed_m;     // driven since it began
    float unheard_m;      // driven since its last echo
    uint8_t bent;         // echoes in a row that left its line without a jump
    uint16_t reading_mm;  // last one before the wall is known
  };
  void predict();
  void begin(uint8_t side, uint16_t range_mm);
  bool believable(const Drift& drift) const;
  void take_back();
  void forget(uint8_t state);
  void add_row(uint8_t to, uint8_t from, float factor);

  float covariance_[kStates][kStates];
  Wall walls_[2];
  // What the gyro alone would be off by, and what was added since the last standstill
  float plain_yaw_, plain_both_, plain_bias_;
  Drift added_;
  float added_before_rad_;  // until the last standstill
  float left_to_tell_;      // share of what a stand tells of the gyro's yaw that the walls had not told yet
  bool trusted_;
  uint32_t dt_us_;
  int32_t ticks_, turn_cdeg_;
};

}  // namespace core
