// One wheel's speed controller: feed-forward over the dead zone, and PI on the robot's speed over that wheel.
#pragma once
#include <stdint.h>

#include "../config.h"
#include "fixed_point.h"

namespace core {

class Wheel {
 public:
  Wheel() : integral_q16_(0), dead_ms_(0) {}
  void reset() {
    integral_q16_ = 0;
    dead_ms_ = 0;
  }
  // Every control tick; speeds in mm/s * 256; `ticking`: its encoder counts. Returns PWM -255..255.
  int16_t control(int32_t wanted_q8, int32_t actual_q8, bool ticking) {
    const int32_t error_q8 = clamp(wanted_q8 - actual_q8, config::kSpeedLimit_mm_s * 256);
    int32_t pwm_q8 = (wanted_q8 * config::kPwmFeedForward_q8) >> 8;
    if (wanted_q8 > 256) pwm_q8 += config::kPwmDeadZone * 256;
    if (wanted_q8 < -256) pwm_q8 -= config::kPwmDeadZone * 256;
    pwm_q8 += (error_q8 * config::kPwmProportional_q8) >> 8;
    const int32_t pwm = clamp((pwm_q8 + (integral_q16_ >> 8)) / 256, 255);
    // No more winding up while the output is at its end
    const bool at_end = (pwm == 255 && error_q8 > 0) || (pwm == -255 && error_q8 < 0);
    if (!at_end) {
      integral_q16_ += (error_q8 * config::kPwmIntegral_q16) / 256;
      integral_q16_ = clamp(integral_q16_, config::kPwmIntegralMax * 65536);
    }
    const bool dead = !ticking && magnitude(pwm) >= config::kEncoderDeadPwm;
    dead_ms_ = dead ? static_cast<uint16_t>(dead_ms_ + config::kTick_ms) : 0;
    return static_cast<int16_t>(pwm);
  }
  // Driven hard for long without a tick: encoder unplugged, or wheel stuck
  bool encoder_dead() const { return dead_ms_ >= config::kEncoderDead_ms; }

 private:
  int32_t integral_q16_;
  uint16_t dead_ms_;
};

}  // namespace core
