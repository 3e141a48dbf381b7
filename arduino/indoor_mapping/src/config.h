// Every number of the firmware, in one place. Where a comment has `= ...`, the same number stands in
// common/constants.py (converted as in the comment); a test compares the two.
// Units in the names: mm, ms, us, cdeg = 0.01 deg, cdps = 0.01 deg/s, mm_s, q8 = times 256.
#pragma once
#include <stdint.h>

namespace config {

// Body
static const int32_t kHullRadius_mm = 220;           // = FOOTPRINT_RADIUS_M * 1000
static const int32_t kSonarRingRadius_mm = 70;       // = SONAR_RING_RADIUS_M * 1000
static const int32_t kWheelTrack_mm = 300;           // = WHEEL_TRACK_M * 1000
static const int32_t kWheelDiameter_um = 66000;      // = WHEEL_DIAMETER_M * 1e6
static const int32_t kEncoderTicksPerTurn = 1440;    // = ENCODER_TICKS_PER_TURN
static const int32_t kTick_nm = 143990;              // = TICK_M * 1e9

// Speeds
static const int32_t kSpeedMedium_mm_s = 160;        // = SPEED_MEDIUM_M_S * 1000
static const int32_t kSpeedHigh_mm_s = 500;          // = SPEED_HIGH_M_S * 1000
static const int32_t kSpeedLimit_mm_s = 300;         // = SPEED_LIMIT_M_S * 1000
static const int32_t kAcceleration_mm_s2 = 300;
static const int32_t kHardBraking_mm_s2 = 2400;      // heartbeats lost, contact: HIGH to nothing in 125 ms

// Heading
static const int32_t kTurnOnSpot_cdeg = 1500;        // = degrees(TURN_ON_SPOT_RAD) * 100
static const int32_t kTurnRateMax_cdps = 6000;
static const int32_t kTurnBraking_cdps2 = 6000;      // planned; the wheels can do more
static const int32_t kTurnLead_ms = 120;             // how far the wheels lag behind their set-point
static const int32_t kTurnRateMin_cdps = 200;
static const int32_t kTurnDone_cdeg = 50;            // = degrees(ANGLE_ERROR_RAD) * 100 / 2
static const int32_t kTurnSettle_ms = 120;
static const int32_t kTurnTimeout_ms = 20000;
static const int32_t kHoldGain = 5;                  // deg/s per degree off the heading
static const int32_t kHoldRateMax_cdps = 3000;
static const int32_t kTurnAcceleration_cdps2 = 12000;

// Wheel speed control: PWM = dead zone + feed-forward * speed + PI of the error
static const int32_t kPwmDeadZone = 15;
static const int32_t kPwmFeedForward_q8 = 158;       // (200 - 15) / 300 PWM per mm/s
static const int32_t kPwmProportional_q8 = 90;       // 0.35 PWM per mm/s
static const int32_t kPwmIntegral_q16 = 2000;        // 3 PWM per mm/s and second, at 100 Hz
static const int32_t kPwmIntegralMax = 90;

// Contact (CAR_MR_04)
static const int32_t kSafeDistance_mm = 50;          // = SAFE_DISTANCE_M * 1000
static const int32_t kClearDistance_mm = 80;         // backing off ends beyond this
static const int32_t kBackOffSpeed_mm_s = 70;
static const int32_t kBackOffMin_mm = 40;            // bumper and cliff: let go, and a bit more
static const int32_t kApproach_mm = 100;             // by as much a thing comes nearer between two readings

// Backwards, where no sensor looks: only over floor that was driven just now
static const int32_t kReverseMax_mm = 500;           // = REVERSE_MAX_M * 1000
static const int32_t kReverseFresh_ms = 10000;
static const int32_t kReverseStep_mm = 50;           // between two places that are remembered
static const int32_t kReverseAside_mm = 100;         // beside the way that was driven, the footprint still covers most of it

// Sonars (LV-MaxSonar)
static const uint8_t kSonarCount = 5;                // = SONAR_COUNT
static const uint16_t kSonarCycle_ms = 49;
static const uint16_t kSonarPowerUp_ms = 250;
static const uint16_t kSonarNothing_us = 37400;      // longer pulses: no echo
static const uint16_t kSonarAgeMax_ms = 250;         // = SONAR_AGE_MAX_S * 1000
static const uint16_t kSonarSilent_ms = 1000;

// Gyro (MPU-6050, +-500 deg/s)
static const int32_t kGyroLsbPer10Dps = 655;         // 65.5 per deg/s
static const uint16_t kGyroBootSamples = 200;
static const int16_t kGyroBootSpread_lsb = 131;      // 2 deg/s from the lowest to the highest: it stands still
static const int16_t kGyroStillGate_lsb = 66;        // 1 deg/s from the bias: still standing
static const uint16_t kStandstill_ms = 200;          // no tick for this long
static const uint16_t kImuSilent_ms = 50;
static const float kGyroNoise_rad_s = 8.7e-4f;         // of one sample, 0.05 deg/s
static const float kGyroWalk_rad_s_sqrt_s = 3.5e-5f;  // of its bias, 0.002 deg/s after one second
static const float kGyroScaleError = 0.003f;
static const int32_t kTiltTicks = 64;                // over which pitch and roll are smoothed

// Heading by walls
static const float kSonarStep_m = 0.0254f;           // = SONAR_STEP_M
static const uint16_t kSonarMin_mm = 152;            // = SONAR_MIN_M * 1000: nearer things read as this
static const float kRangeNoise = 0.004f;             // share of the range
static const float kWallRoughness_m = 0.003f;
static const float kWallBend_rad_sqrt_m = 8.7e-4f;   // slow bending of a straight wall, 0.05 deg after one metre
static const float kWallSlant_rad = 0.17f;           // of a wall that begins, either way
static const float kWallAngleMax_rad = 0.52f;        // to the robot's heading: beyond, the foot leaves the beam
static const float kWallProof_m = 3.0f;              // as long it is only listened to
static const float kWallKept_m = 3.0f;               // over openings and niches
static const float kWallMisfit = 4.0f;               // standard deviations: not an echo of this wall
static const float kWallJump_m = 0.051f;              // an echo further off is of something else
static const uint8_t kWallBendEchoes = 4;            // off the line by less, in a row: the wall bends
static const float kDriftMisfit = 4.0f;              // standard deviations: the gyro cannot have drifted so far

// Safety chain
static const uint16_t kHeartbeatTimeout_ms = 250;    // = HEARTBEAT_TIMEOUT_S * 1000
static const uint16_t kDriverOff_ms = 380;           // since the last heartbeat
static const uint16_t kDisarm_ms = 1000;             // = DISARM_TIMEOUT_S * 1000

// Faults
static const int32_t kEncoderDeadPwm = 80;           // driven this hard ...
static const uint16_t kEncoderDead_ms = 500;         // ... for this long without a tick
static const uint16_t kBatteryLow_mv = 10500;        // = BATTERY_LOW_V * 1000

// Wiring of the Mega. The name ends with the port, the number is the bit in it, the comment the number on the board.
// Encoders and motor PWM sit on pins whose interrupt or timer is theirs alone, see src/hal/; they cannot be moved here.
static const uint8_t kDirLeft_A = 0;                 // D22
static const uint8_t kDirRight_A = 1;                // D23
static const uint8_t kEnable_A = 2;                  // D24, pull-down of 10 kOhm to ground at the driver
static const uint8_t kBumper_A = 3;                  // D25
static const uint8_t kCliffLeft_A = 4;               // D26
static const uint8_t kCliffRight_A = 5;              // D27
static const uint8_t kStopButton_A = 6;              // D28
static const uint8_t kPwmRight_L = 4;                // D45, OC5B
static const uint8_t kPwmLeft_L = 5;                 // D44, OC5C
static const uint8_t kSonarPulse_B[kSonarCount] = {0, 1, 2, 3, 4};    // D53, D52, D51, D50, D10; in the sonars' order
static const uint8_t kSonarTrigger_C[kSonarCount] = {7, 6, 5, 4, 3};  // D30 to D34
static const uint8_t kEncoderLeftA_E = 4;            // D2, INT4
static const uint8_t kEncoderRightA_E = 5;           // D3, INT5
static const uint8_t kEncoderRightB_D = 2;           // D19, INT2
static const uint8_t kEncoderLeftB_D = 3;            // D18, INT3
static const uint8_t kBattery_F = 0;                 // A0

// What is fitted. Each input reads "danger" when its wire is off, so one that is not there has to be named here
static const bool kBumperFitted = true;
static const bool kCliffFitted = true;
static const bool kStopButtonFitted = true;
static const bool kLeftMotorReversed = false;        // turns backwards at a positive speed
static const bool kRightMotorReversed = false;
static const bool kLeftEncoderReversed = false;      // counts down when the wheel rolls forwards
static const bool kRightEncoderReversed = false;

// Drivers
static const uint32_t kBaud = 250000;              // = SERIAL_BAUD
static const uint8_t kPwmStep = 3;                   // timer counts per PWM unit: 16 MHz / (3 * 255 + 1) = 20.9 kHz
static const uint8_t kImuPeriod_ms = 5;              // between two readings of the MPU-6050
static const uint8_t kImuTimeout_ms = 3;             // a transfer takes 0.5 ms
static const uint16_t kBatteryFull_mv = 15000;       // at 5 V behind the divider of 20 and 10 kOhm
static const uint8_t kLoopLockup_ms = 60;            // no pass of the loop for this long: motors off; then the watchdog

// Rhythm
static const uint16_t kTick_ms = 10;
static const uint8_t kReportTicks = 10;              // = 100 / SENSOR_RATE_HZ
static const uint16_t kHello_ms = 1000;

}  // namespace config
