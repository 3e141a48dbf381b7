// The body of the simulated robot, step by step: motors and wheels, MuJoCo, encoders, IMU, firmware.
//
// It is Python's arithmetic, operation by operation, so that a run is the same to the bit as one stepped there: the
// inner loop of a simulation is the one place where Python's own time is most of it.
#include "body.h"

#include <math.h>
#include <time.h>

#include <mujoco/mjdata.h>

namespace {

const double kPi = 3.14159265358979323846;
const double kNothingLeft_s = 1e-9;

int64_t now_ns() {
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

double uniform(Normals& normals) {
  if (normals.used == normals.count) normals.refill();
  return normals.uniform[normals.used++];
}

// As Python's random.gauss
double gauss(Normals& normals, double sd) {
  if (normals.has_spare) {
    normals.has_spare = 0;
    return normals.spare * sd;
  }
  const double angle_rad = uniform(normals) * (2.0 * kPi);
  const double length = sqrt(-2.0 * log(1.0 - uniform(normals)));
  normals.spare = sin(angle_rad) * length;
  normals.has_spare = 1;
  return cos(angle_rad) * length * sd;
}

double drive_m_s(const DriveTrain& train, int pwm) {
  if (pwm > train.dead_zone_pwm) return (pwm - train.dead_zone_pwm) * train.speed_per_pwm_m_s;
  const double beyond = pwm + train.dead_zone_pwm;
  return (beyond < 0.0 ? beyond : 0.0) * train.speed_per_pwm_m_s;
}

double wheel_m_s(DriveTrain& train, int wheel, int pwm, bool enabled) {
  double rim_m_s = train.rim_m_s[wheel];
  if (enabled) {
    rim_m_s += train.motor_response * (drive_m_s(train, pwm) - rim_m_s);
  } else if (rim_m_s == 0.0) {
    return 0.0;
  } else {
    const double loss_m_s = train.friction_m_s2 * train.step_s;
    rim_m_s = rim_m_s > 0.0 ? fmax(rim_m_s - loss_m_s, 0.0) : fmin(rim_m_s + loss_m_s, 0.0);
  }
  if (-train.standing_m_s < rim_m_s && rim_m_s < train.standing_m_s) {
    train.rim_m_s[wheel] = 0.0;
    return 0.0;
  }
  train.rim_m_s[wheel] = rim_m_s;
  const double rolled_m = rim_m_s * train.step_s;
  train.rolled_m[wheel] += rolled_m;
  if (train.slip_sd > 0.0) {
    const double share = fmin(fabs(rolled_m) / train.slip_length_m, 1.0);
    const double slip = train.slip[wheel];
    train.slip[wheel] = slip + (-share * slip + gauss(train.normals, train.slip_sd * sqrt(2.0 * share)));
  }
  return rim_m_s * train.diameter_factor[wheel] * (1.0 + train.slip[wheel]);
}

double bump_rad_s(DriveTrain& train, double driven_m) {
  train.next_bump_m -= driven_m;
  if (train.next_bump_m <= 0.0) train.draw_bump();
  if (train.bump_left_s <= kNothingLeft_s) return 0.0;
  train.bump_left_s -= train.step_s;
  return train.bump_rad_s;
}

int32_t count_of(double value) {
  const double count = rint(value);  // to the nearest, of two to the even one
  return static_cast<int32_t>(count < -32768.0 ? -32768.0 : count > 32767.0 ? 32767.0 : count);
}

int32_t gyro_count(Imu& imu, int axis, double rate_rad_s) {
  if (imu.walk_rad_s > 0.0) imu.bias_rad_s[axis] += gauss(imu.normals, imu.walk_rad_s);
  double measured_rad_s = rate_rad_s * imu.scale + imu.bias_rad_s[axis];
  if (imu.white_rad_s > 0.0) measured_rad_s += gauss(imu.normals, imu.white_rad_s);
  return count_of(measured_rad_s * (180.0 / kPi) * imu.gyro_counts);
}

// x modulo a full turn, as Python has it: from 0 on
double full_turn_modulo(double x) {
  const double rest = fmod(x, 2.0 * kPi);
  return rest < 0.0 ? rest + 2.0 * kPi : rest;
}

}  // namespace

extern "C" {

void drive_train_step(DriveTrain* train, int pwm_left, int pwm_right, int enabled) {
  const double left_m_s = wheel_m_s(*train, 0, pwm_left, enabled != 0);
  const double right_m_s = wheel_m_s(*train, 1, pwm_right, enabled != 0);
  double yaw_rate_rad_s = (right_m_s - left_m_s) / train->track_m;
  if (train->bumps) yaw_rate_rad_s += bump_rad_s(*train, fabs(left_m_s + right_m_s) * 0.5 * train->step_s);
  train->speed_m_s = 0.5 * (left_m_s + right_m_s);
  train->yaw_rate_rad_s = yaw_rate_rad_s;
}

void drive_train_edges(DriveTrain* train, int32_t* edges) {
  for (int wheel = 0; wheel < 2; ++wheel) {
    const int64_t ticks = static_cast<int64_t>(floor(train->rolled_m[wheel] * train->ticks_per_m));
    edges[wheel] = static_cast<int32_t>(ticks - train->ticks[wheel]);
    train->ticks[wheel] = ticks;
  }
}

void imu_sample(Imu* imu, double heading_rad, double vx_m_s, double vy_m_s) {
  const double turned_rad = full_turn_modulo(heading_rad - imu->heading_rad + kPi) - kPi;
  const double ax_m_s2 = (vx_m_s - imu->velocity_m_s[0]) / imu->period_s;
  const double ay_m_s2 = (vy_m_s - imu->velocity_m_s[1]) / imu->period_s;
  const double c = cos(heading_rad), s = sin(heading_rad);
  imu->counts[0] = count_of((c * ax_m_s2 + s * ay_m_s2) * imu->accel_counts);
  imu->counts[1] = count_of((c * ay_m_s2 - s * ax_m_s2) * imu->accel_counts);
  imu->counts[2] = 16384;
  imu->counts[3] = gyro_count(*imu, 0, 0.0);
  imu->counts[4] = gyro_count(*imu, 1, 0.0);
  imu->counts[5] = gyro_count(*imu, 2, turned_rad / imu->period_s);
  imu->heading_rad = heading_rad;
  imu->velocity_m_s[0] = vx_m_s;
  imu->velocity_m_s[1] = vy_m_s;
}

// One step of everything up to what the board receives of it
void body_move(Body* body) {
  DriveTrain* train = body->drive_train;
  mjData* data = static_cast<mjData*>(body->data);
  const int32_t* outputs = body->board.run ? body->board.outputs : body->outputs;
  ++body->steps;
  drive_train_step(train, outputs[0], outputs[1], outputs[2]);
  const double yaw_rate_rad_s = train->yaw_rate_rad_s + body->hand_turn_rad_s;
  const double middle_rad = data->qpos[2] + 0.5 * yaw_rate_rad_s * train->step_s;
  data->ctrl[0] = train->speed_m_s * cos(middle_rad);
  data->ctrl[1] = train->speed_m_s * sin(middle_rad);
  data->ctrl[2] = yaw_rate_rad_s;
  body->step(body->model, body->data);
  body->touched = data->ncon > 0;
  drive_train_edges(train, body->edges);
  body->sampled = body->steps % body->imu_steps == 0;
  if (!body->sampled) return;
  const int64_t began_ns = now_ns();
  imu_sample(body->imu, data->qpos[2], data->qvel[0], data->qvel[1]);
  body->imu_ns += now_ns() - began_ns;
}

// The board's part of the step
void body_run_board(Body* body) {
  const int64_t began_ns = now_ns();
  const int32_t* counts = body->imu->counts;
  if (body->sampled) {
    body->board.imu(body->board.board, counts[0], counts[1], counts[2], counts[3], counts[4], counts[5]);
  }
  const uint64_t until_us = static_cast<uint64_t>(body->steps * body->step_us - body->power_on_us);
  body->board.run(body->board.board, until_us, body->edges[0], body->edges[1]);
  body->board_ns += now_ns() - began_ns;
}

// Up to `count` steps; fewer where the board fired a sonar or began to send, or the body touches or left something: then
// the board has not run that step yet (`body_run_board`). Returns how many
int body_run(Body* body, int count) {
  for (int step = 1; step <= count; ++step) {
    body_move(body);
    if (body->touched || body->touching) return step;
    body_run_board(body);
    if (body->board.outputs[3] || *body->board.tx_length) return step;
  }
  return count;
}

}  // extern "C"
