// The safety state machine: a table and a pure function. Everything that may turn a wheel checks it.
#pragma once
#include <stdint.h>

#include "protocol.h"

namespace core {

// What holds right now
enum Condition : uint8_t {
  kCalibrated = 1,      // gyro bias known
  kArmed = 2,           // START came, and heartbeats have not been away for a second since
  kHeartbeat = 4,       // one came within the last 250 ms
  kStopLatched = 8,     // stop byte, STOP or button, not released yet
  kFaulty = 16,         // IMU silent
  kMoving = 32,         // the Carrier has something to do
  kContact = 64,        // the Carrier backs off
};

CarState next_state(CarState state, uint8_t conditions);

}  // namespace core
