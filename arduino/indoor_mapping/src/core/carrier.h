// The Carrier: drive commands in, wheel PWM out. Speed ramp, heading hold, turns on the spot, backing off.
#pragma once
#include <stdint.h>

#include "../config.h"
#include "odometry.h"
#include "protocol.h"
#include "retreat.h"
#include "sonar.h"
#include "wheel.h"

namespace core {

struct Obstacles {
  bool contact;  // a sonar in front is sure of it
  bool clear_in_front;
  bool bumper, cliff;
};

class Carrier {
 public:
  Carrier();
  // A new command; false when it is the one given up last, or the robot is backing off. The one in force again: true.
  // A command to stand is never taken for one that is known.
  bool drive(const Drv& command);
  // Gives the command in force up and comes to a stop: hard within 150 ms, or gently
  void abandon(bool hard);
  // Every control tick
  void update(const Odometry& odometry, const Obstacles& obstacles);
  // Motors off this instant
  void cut();

  bool moving() const;
  bool backing_off() const { return mode_ == kBackOff; }
  int16_t pwm_left() const { return pwm_left_; }
  int16_t pwm_right() const { return pwm_right_; }
  // Whose commands the ids below are
  int32_t boot() const { return command_.boot; }
  int32_t command_id() const { return command_.command_id; }
  int32_t completed_id() const { return completed_id_; }
  int32_t aborted_id() const { return aborted_id_; }
  // Why the newest command was given up, until the next one
  int16_t error() const { return error_; }

 private:
  enum Mode : uint8_t { kIdle, kDrive, kBrake, kTurn, kBackOff };
  int32_t wanted_speed_mm_s() const;
  void follow_heading(int32_t error_cdeg);
  void turn(const Odometry& odometry, int32_t error_cdeg);
  void watch_contact(const Odometry& odometry, const Obstacles& obstacles);
  void back_off(const Odometry& odometry, const Obstacles& obstacles, int32_t error_cdeg);
  void ramp(int32_t speed_mm_s, bool hard);
  void drive_wheels(const Odometry& odometry);
  void give_up(int16_t why);

  Mode mode_;
  Drv command_;            // command_id 0: none
  int32_t completed_id_, aborted_id_;
  int16_t error_;
  bool hard_;              // braking hard
  int32_t speed_q8_;       // set-point, mm/s
  int32_t rate_cdps_;      // set-point
  int32_t hold_cdeg_;      // heading held while backing off
  int32_t from_ticks_;     // sum of both wheels where the turn or the backing off began
  uint16_t settled_ms_;
  uint16_t turning_ms_;
  Retreat retreat_;
  Wheel left_, right_;
  int16_t pwm_left_, pwm_right_;
};

}  // namespace core
