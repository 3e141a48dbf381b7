#include "carrier.h"

#include "errors.h"
#include "fixed_point.h"

namespace core {
namespace {

const int32_t kRamp_q8 = config::kAcceleration_mm_s2 * 256 * config::kTick_ms / 1000;
const int32_t kHardRamp_q8 = config::kHardBraking_mm_s2 * 256 * config::kTick_ms / 1000;
const int32_t kRateStep_cdps = config::kTurnAcceleration_cdps2 * config::kTick_ms / 1000;
const int32_t kStanding_q8 = 10 * 256;
const int32_t kTickHalf_q8x1000 = config::kTick_nm * 256 / 2000;  // mm * 2^8 * 1000 per tick of the sum

// Speed of a wheel, mm/s * 256, from a turning rate: track / 2 * pi / 18000 * 256, in q10
int32_t wheel_q8(int32_t rate_cdps) { return (rate_cdps * (config::kWheelTrack_mm * 22877 / 1000)) / 1024; }

int32_t to_mm_q8(int32_t ticks_sum) { return ticks_sum * (kTickHalf_q8x1000 / 8) / 125; }

}  // namespace

Carrier::Carrier()
    : mode_(kIdle), completed_id_(0), aborted_id_(0), error_(kOk), hard_(false), speed_q8_(0), rate_cdps_(0),
      hold_cdeg_(0), from_ticks_(0), settled_ms_(0), turning_ms_(0), pwm_left_(0), pwm_right_(0) {
  command_.boot = 0;
  command_.command_id = 0;
  command_.speed = 0;
  command_.yaw_cdeg = 0;
}

bool Carrier::drive(const Drv& command) {
  if (command.boot != command_.boot) {
    command_.boot = command.boot;
    command_.command_id = completed_id_ = aborted_id_ = 0;
  }
  if (command.command_id == command_.command_id && command.speed == command_.speed) return true;
  if (command.command_id == aborted_id_ && command.speed != 0) return false;
  if (mode_ == kBackOff) {
    aborted_id_ = command.command_id;
    return false;
  }
  // A correction while it turns must not keep the turn from ending
  const int32_t change_cdeg = magnitude(wrap_cdeg(command.yaw_cdeg - command_.yaw_cdeg));
  if (change_cdeg > 2 * config::kTurnDone_cdeg) {
    settled_ms_ = 0;
    turning_ms_ = 0;
  }
  command_ = command;
  error_ = kOk;
  hard_ = false;
  if (mode_ == kIdle) mode_ = kDrive;
  return true;
}

void Carrier::give_up(int16_t why) {
  if (command_.command_id) aborted_id_ = command_.command_id;
  command_.command_id = 0;
  error_ = why;
}

void Carrier::abandon(bool hard) {
  give_up(kOk);
  hard_ = hard;
  if (mode_ != kIdle) mode_ = kBrake;
}

void Carrier::cut() {
  give_up(kOk);
  mode_ = kIdle;
  speed_q8_ = 0;
  rate_cdps_ = 0;
  pwm_left_ = pwm_right_ = 0;
  left_.reset();
  right_.reset();
}

bool Carrier::moving() const { return mode_ != kIdle; }

int32_t Carrier::wanted_speed_mm_s() const {
  switch (command_.speed) {
    case -1:
      return retreat_.allowed(-config::kSpeedMedium_mm_s);
    case 1:
      return config::kSpeedMedium_mm_s;
    case 2:
      return config::kSpeedHigh_mm_s;
    default:
      return 0;
  }
}

void Carrier::ramp(int32_t speed_mm_s, bool hard) {
  // The outer wheel must keep within what a motor reaches
  const int32_t room_q8 = config::kSpeedLimit_mm_s * 256 - magnitude(wheel_q8(rate_cdps_));
  speed_q8_ = approach(speed_q8_, clamp(speed_mm_s * 256, room_q8), hard ? kHardRamp_q8 : kRamp_q8);
}

void Carrier::follow_heading(int32_t error_cdeg) {
  const int32_t rate = clamp(error_cdeg * config::kHoldGain, config::kHoldRateMax_cdps);
  rate_cdps_ = approach(rate_cdps_, rate, kRateStep_cdps);
}

void Carrier::turn(const Odometry& odometry, int32_t error_cdeg) {
  const int32_t rate = odometry.gyro().rate_cdps();
  const int32_t away = magnitude(error_cdeg);
  // Plan the braking from where the wheels' lag will have carried it
  const bool closing = (rate > 0) == (error_cdeg > 0);
  int32_t left = away - (closing ? magnitude(rate) * config::kTurnLead_ms / 1000 : 0);
  if (left < 0) left = 0;
  int32_t wanted = square_root(2u * static_cast<uint32_t>(config::kTurnBraking_cdps2) * static_cast<uint32_t>(left));
  if (wanted > left * 3) wanted = left * 3;
  if (wanted < config::kTurnRateMin_cdps) wanted = config::kTurnRateMin_cdps;
  wanted = clamp(wanted, config::kTurnRateMax_cdps);
  const bool there = away <= config::kTurnDone_cdeg;
  if (there) wanted = 0;
  rate_cdps_ = approach(rate_cdps_, error_cdeg < 0 ? -wanted : wanted, kRateStep_cdps);
  if (there) rate_cdps_ = 0;

  // About its own centre: what the middle moved away, it moves back
  const int32_t off_mm_q8 = to_mm_q8(odometry.ticks_left() + odometry.ticks_right() - from_ticks_);
  speed_q8_ = there ? 0 : clamp(-2 * off_mm_q8, 20 * 256);

  const bool calm = there && magnitude(rate) < config::kTurnRateMin_cdps;
  settled_ms_ = calm ? static_cast<uint16_t>(settled_ms_ + config::kTick_ms) : 0;
  turning_ms_ = static_cast<uint16_t>(turning_ms_ + config::kTick_ms);
  if (settled_ms_ >= config::kTurnSettle_ms) {
    completed_id_ = command_.command_id;
    mode_ = command_.speed ? kDrive : kIdle;
  } else if (turning_ms_ >= config::kTurnTimeout_ms) {
    give_up(kEncoderImplausible);
    mode_ = kBrake;
  }
}

void Carrier::watch_contact(const Odometry& odometry, const Obstacles& obstacles) {
  if (mode_ != kDrive || command_.speed <= 0) return;
  int16_t why = kOk;
  if (obstacles.contact) why = kBackingOff;
  if (obstacles.cliff) why = kCliff;
  if (obstacles.bumper) why = kBumper;
  if (why == kOk) return;
  give_up(why);
  hard_ = true;
  from_ticks_ = odometry.ticks_left() + odometry.ticks_right();
  hold_cdeg_ = odometry.yaw_cdeg();
  mode_ = kBackOff;
}

void Carrier::back_off(const Odometry& odometry, const Obstacles& obstacles, int32_t error_cdeg) {
  if (speed_q8_ > 0) {
    rate_cdps_ = 0;
    ramp(0, true);
    return;
  }
  const int32_t backed_mm_q8 = to_mm_q8(from_ticks_ - odometry.ticks_left() - odometry.ticks_right());
  const bool far_enough = backed_mm_q8 >= config::kBackOffMin_mm * 256 || error_ == kBackingOff;
  const bool clear = obstacles.clear_in_front && !obstacles.bumper && !obstacles.cliff;
  const int32_t speed_mm_s = retreat_.allowed(-config::kBackOffSpeed_mm_s);
  const bool at_rest = speed_q8_ == 0 && magnitude(odometry.wheel_speed_q8(false)) < kStanding_q8;
  if (speed_mm_s == 0 || (clear && far_enough)) {
    ramp(0, true);
    if (speed_q8_ == 0 && at_rest) mode_ = kIdle;
    return;
  }
  follow_heading(error_cdeg);
  ramp(speed_mm_s, false);
}

void Carrier::update(const Odometry& odometry, const Obstacles& obstacles) {
  const int32_t sum = odometry.ticks_left() + odometry.ticks_right();
  retreat_.update(odometry);

  // A turn comes first: it leads away from what stands in front
  int32_t error_cdeg = wrap_cdeg(command_.yaw_cdeg - odometry.yaw_cdeg());
  if (mode_ == kDrive && (command_.speed == 0 || magnitude(error_cdeg) > config::kTurnOnSpot_cdeg)) mode_ = kBrake;
  watch_contact(odometry, obstacles);
  if (mode_ == kBackOff) error_cdeg = wrap_cdeg(hold_cdeg_ - odometry.yaw_cdeg());
  const int32_t speed_q8 = (odometry.wheel_speed_q8(false) + odometry.wheel_speed_q8(true)) / 2;
  const bool blocked = obstacles.contact || obstacles.bumper || obstacles.cliff;

  if (mode_ == kDrive) {
    const int32_t speed_mm_s = wanted_speed_mm_s();
    follow_heading(speed_mm_s ? error_cdeg : 0);
    ramp(speed_mm_s, blocked && speed_q8_ > 0);
    if (magnitude(error_cdeg) < 2 * config::kTurnDone_cdeg) completed_id_ = command_.command_id;
  } else if (mode_ == kBrake) {
    rate_cdps_ = approach(rate_cdps_, 0, kRateStep_cdps);
    if (hard_) rate_cdps_ = 0;
    ramp(0, hard_ || (blocked && speed_q8_ > 0));
    if (speed_q8_ == 0 && rate_cdps_ == 0 && magnitude(speed_q8) < kStanding_q8) {
      mode_ = command_.command_id ? kTurn : kIdle;
      from_ticks_ = sum;
      settled_ms_ = 0;
      turning_ms_ = 0;
    }
  } else if (mode_ == kTurn) {
    turn(odometry, error_cdeg);
  } else if (mode_ == kBackOff) {
    back_off(odometry, obstacles, error_cdeg);
  }
  drive_wheels(odometry);
}

void Carrier::drive_wheels(const Odometry& odometry) {
  if (mode_ == kIdle || (speed_q8_ == 0 && rate_cdps_ == 0)) {
    left_.reset();
    right_.reset();
    pwm_left_ = pwm_right_ = 0;
    if (mode_ == kIdle) speed_q8_ = rate_cdps_ = 0;
    return;
  }
  // The encoders measure how fast the robot goes, the gyro how fast it turns: a wheel that slips deceives only its encoder
  const int32_t left_q8 = odometry.wheel_speed_q8(false), right_q8 = odometry.wheel_speed_q8(true);
  const int32_t middle_q8 = (left_q8 + right_q8) / 2, turning_q8 = wheel_q8(odometry.gyro().rate_cdps());
  const int32_t apart_q8 = wheel_q8(rate_cdps_);
  pwm_left_ = left_.control(speed_q8_ - apart_q8, middle_q8 - turning_q8, left_q8 != 0);
  pwm_right_ = right_.control(speed_q8_ + apart_q8, middle_q8 + turning_q8, right_q8 != 0);
  if (left_.encoder_dead() || right_.encoder_dead()) {
    cut();
    error_ = kEncoderImplausible;
  }
}

}  // namespace core
