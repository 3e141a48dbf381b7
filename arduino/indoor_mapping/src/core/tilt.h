// Pitch and roll from the direction of gravity: with SIM's yaw, the specification's yaw-pitch-roll output.
#pragma once
#include <stdint.h>

#include "../config.h"
#include "fixed_point.h"

namespace core {

class Tilt {
 public:
  Tilt() : x_q8_(0), y_q8_(0), z_q8_(0), begun_(false) {}
  // Every control tick, accelerometer counts; what the robot's own motion adds is smoothed away
  void sample(int16_t ax, int16_t ay, int16_t az) {
    follow(ax, &x_q8_);
    follow(ay, &y_q8_);
    follow(az, &z_q8_);
    begun_ = true;
  }
  // Nose up positive
  int32_t pitch_cdeg() const {
    const int32_t y = y_q8_ >> 8, z = z_q8_ >> 8;
    return arctangent_cdeg(x_q8_ >> 8, square_root(static_cast<uint32_t>(y * y) + static_cast<uint32_t>(z * z)));
  }
  // Left side up positive
  int32_t roll_cdeg() const { return arctangent_cdeg(y_q8_ >> 8, z_q8_ >> 8); }

 private:
  void follow(int16_t counts, int32_t* mean_q8) {
    const int32_t error_q8 = static_cast<int32_t>(counts) * 256 - *mean_q8;
    *mean_q8 += begun_ ? error_q8 / config::kTiltTicks : error_q8;
  }
  int32_t x_q8_, y_q8_, z_q8_;
  bool begun_;
};

}  // namespace core
