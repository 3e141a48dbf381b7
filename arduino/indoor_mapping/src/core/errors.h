// The firmware's rows of the one table of error codes, common/errors.py; a test compares the two.
#pragma once
#include <stdint.h>

namespace core {

static const int16_t kOk = 0;                    // = OK
static const int16_t kSonarSilent = 101;         // = SONAR_SILENT
static const int16_t kImuSilent = 102;           // = IMU_SILENT
static const int16_t kEncoderImplausible = 103;  // = ENCODER_IMPLAUSIBLE
static const int16_t kBatteryLow = 104;          // = BATTERY_LOW
static const int16_t kHeartbeatLost = 201;       // = HEARTBEAT_LOST
static const int16_t kBackingOff = 202;          // = BACKING_OFF
static const int16_t kBumper = 203;              // = BUMPER
static const int16_t kCliff = 204;               // = CLIFF
static const int16_t kStopped = 205;             // = STOP_LATCHED
static const int16_t kLoopLockup = 206;          // = LOOP_LOCKUP

}  // namespace core
