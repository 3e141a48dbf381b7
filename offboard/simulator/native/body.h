// What body.cpp shares with Python (library.py has the same structures, field by field).
#pragma once
#include <stdint.h>

// Numbers from 0 to 1 of one random stream, which Python draws block by block, and normal ones made of them
struct Normals {
  const double* uniform;
  int64_t count, used;
  double spare;  // normal numbers are made in pairs
  int64_t has_spare;
  void (*refill)();
};

// offboard/simulator/physics/drive_train.py
struct DriveTrain {
  double step_s, motor_response, dead_zone_pwm, speed_per_pwm_m_s, friction_m_s2, standing_m_s, slip_length_m;
  double slip_sd, track_m, ticks_per_m, diameter_factor[2];
  int64_t bumps;  // does anything turn the body without a wheel?
  double rim_m_s[2], rolled_m[2], slip[2];
  double next_bump_m, bump_rad_s, bump_left_s;
  int64_t ticks[2];
  double speed_m_s, yaw_rate_rad_s;  // of the newest step
  void (*draw_bump)();
  Normals normals;
};

// offboard/simulator/sensors/imu.py
struct Imu {
  double period_s, scale, walk_rad_s, white_rad_s, accel_counts, gyro_counts, bias_rad_s[3];
  double heading_rad, velocity_m_s[2];  // at the last sample
  int32_t counts[6];
  Normals normals;
};

// A board as `NativeBoard` holds it; no `run` where the board is a Python object
struct BoardCalls {
  void* board;
  void (*run)(void*, uint64_t, int, int);
  void (*imu)(void*, int, int, int, int, int, int);
  const int32_t* outputs;  // PWM left and right, enabled, sonars fired
  const uint32_t* tx_length;
};

// offboard/simulator/physics/body.py
struct Body {
  DriveTrain* drive_train;
  Imu* imu;
  BoardCalls board;
  void* model;
  void* data;
  void (*step)(const void*, void*);  // mj_step
  double hand_turn_rad_s;
  int64_t steps, step_us, power_on_us, imu_steps;
  int32_t outputs[3];  // where the board is a Python object
  int32_t touched, touching;  // a contact in this step; one that presses the bumper still
  int32_t edges[2];           // of this step
  int32_t sampled;            // the IMU was
  int64_t imu_ns, board_ns;  // spent since they were booked
};
