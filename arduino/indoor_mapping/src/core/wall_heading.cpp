#include "wall_heading.h"

#include <math.h>

#include "fixed_point.h"

namespace core {
namespace {

const float kTick_m = config::kTick_nm * 1e-9f;
const float kCdeg_rad = 1.745329e-4f;
const float kSampleTime_s = config::kTick_ms * 1e-3f;
const uint8_t kSlices = 8;  // of a step, to sum the density up

float square(float x) { return x * x; }

}  // namespace

WallHeading::WallHeading()
    : covariance_(), walls_(), plain_yaw_(0), plain_both_(0), plain_bias_(0), added_(),
      added_before_rad_(0), left_to_tell_(1), trusted_(false), dt_us_(0), ticks_(0), turn_cdeg_(0) {}

void WallHeading::forget(uint8_t state) {
  for (uint8_t i = 0; i < kStates; ++i) covariance_[state][i] = covariance_[i][state] = 0;
}

void WallHeading::stand(float bias_variance, int32_t told_cdeg) {
  if (plain_both_ > 0) left_to_tell_ = covariance_[kYaw][kBias] / plain_both_;
  added_before_rad_ -= (1 - left_to_tell_) * told_cdeg * kCdeg_rad;
  forget(kBias);
  covariance_[kBias][kBias] = plain_bias_ = bias_variance;
  plain_yaw_ = covariance_[kYaw][kYaw];
  plain_both_ = 0;
  added_before_rad_ += added_.yaw_rad;
  added_ = Drift();
  trusted_ = true;
}

int32_t WallHeading::yaw_cdeg() const {
  return static_cast<int32_t>((added_before_rad_ + added_.yaw_rad) / kCdeg_rad);
}

void WallHeading::move(uint32_t dt_us, int32_t ticks, int32_t turn_cdeg) {
  dt_us_ += dt_us;
  ticks_ += ticks;
  turn_cdeg_ += turn_cdeg;
}

void WallHeading::add_row(uint8_t to, uint8_t from, float factor) {
  for (uint8_t i = 0; i < kStates; ++i) covariance_[to][i] += factor * covariance_[from][i];
  for (uint8_t i = 0; i < kStates; ++i) covariance_[i][to] += factor * covariance_[i][from];
}

void WallHeading::predict() {
  const float dt_s = dt_us_ * 1e-6f, way_m = ticks_ * (kTick_m / 2), turn_rad = turn_cdeg_ * kCdeg_rad;
  dt_us_ = 0;
  ticks_ = turn_cdeg_ = 0;
  added_.yaw_rad += added_.rate_rad_s * dt_s;
  for (uint8_t side = 0; side < 2; ++side) {
    Wall& wall = walls_[side];
    if (!wall.known) continue;
    const float nearing_m = side ? -way_m : way_m;
    wall.angle_rad += turn_rad;
    wall.distance_m -= nearing_m * sinf(wall.angle_rad);
    wall.followed_m += fabsf(way_m);
    wall.unheard_m += fabsf(way_m);
    wall.known = wall.unheard_m < config::kWallKept_m && fabsf(wall.angle_rad) < config::kWallAngleMax_rad;
    const uint8_t distance = kWalls + 2 * side, slant = distance + 1;
    add_row(distance, kYaw, -nearing_m);
    add_row(distance, slant, nearing_m);
    covariance_[slant][slant] += square(config::kWallBend_rad_sqrt_m) * fabsf(way_m);
  }
  const float yaw_variance =
      square(config::kGyroScaleError * turn_rad) + square(config::kGyroNoise_rad_s) * kSampleTime_s * dt_s;
  const float bias_variance = square(config::kGyroWalk_rad_s_sqrt_s) * dt_s;
  add_row(kYaw, kBias, dt_s);
  covariance_[kYaw][kYaw] += yaw_variance;
  covariance_[kBias][kBias] += bias_variance;
  plain_yaw_ += dt_s * (2 * plain_both_ + dt_s * plain_bias_) + yaw_variance;
  plain_both_ += dt_s * plain_bias_;
  plain_bias_ += bias_variance;
}

void WallHeading::begin(uint8_t side, uint16_t range_mm) {
  Wall& wall = walls_[side];
  const int32_t apart_mm = magnitude(static_cast<int32_t>(range_mm) - wall.reading_mm);
  wall.reading_mm = range_mm;
  if (apart_mm * 1e-3f > 1.5f * config::kSonarStep_m) return;
  const uint8_t distance = kWalls + 2 * side, slant = distance + 1;
  forget(distance);
  forget(slant);
  covariance_[distance][distance] = square(config::kSonarStep_m) / 12;
  covariance_[slant][slant] = square(config::kWallSlant_rad);
  wall.known = true;
  wall.distance_m = range_mm * 1e-3f + config::kSonarStep_m / 2;
  wall.angle_rad = wall.followed_m = wall.unheard_m = 0;
  wall.bent = 0;
}

bool WallHeading::believable(const Drift& drift) const {
  const float most = square(config::kDriftMisfit);
  return square(added_.yaw_rad + drift.yaw_rad) <= most * plain_yaw_ &&
         square(added_.rate_rad_s + drift.rate_rad_s) <= most * plain_bias_;
}

void WallHeading::take_back() {
  added_ = Drift();
  walls_[0].known = walls_[1].known = trusted_ = false;
  forget(kYaw);
  forget(kBias);
  covariance_[kYaw][kYaw] = plain_yaw_;
  covariance_[kYaw][kBias] = covariance_[kBias][kYaw] = plain_both_;
  covariance_[kBias][kBias] = plain_bias_;
}

void WallHeading::hear(bool right, uint16_t range_mm) {
  predict();
  const uint8_t side = right ? 1 : 0;
  Wall& wall = walls_[side];
  if (!trusted_ || range_mm <= config::kSonarMin_mm) return;
  if (!wall.known) {
    begin(side, range_mm);
    return;
  }
  const uint8_t distance = kWalls + 2 * side;
  const float near_m = range_mm * 1e-3f - wall.distance_m, far_m = near_m + config::kSonarStep_m;
  const float noise = square(config::kRangeNoise * wall.distance_m) + square(config::kWallRoughness_m);
  const float variance = covariance_[distance][distance] + noise;
  const float beside_m = near_m > 0 ? near_m : (far_m < 0 ? far_m : 0);
  if (square(beside_m) > square(config::kWallMisfit) * variance) {
    wall.bent = fabsf(beside_m) < config::kWallJump_m ? wall.bent + 1 : 0;
    if (wall.bent >= config::kWallBendEchoes) take_back();
    return;
  }
  wall.bent = 0;
  wall.unheard_m = 0;

  const float slice_m = config::kSonarStep_m / kSlices;
  float weight = 0, first = 0, second = 0;
  for (uint8_t i = 0; i < kSlices; ++i) {
    const float at_m = near_m + slice_m * (i + 0.5f), density = expf(-0.5f * square(at_m) / variance);
    weight += density;
    first += density * at_m;
    second += density * square(at_m);
  }
  const float off_m = first / weight;
  const float left_over = second / weight - square(off_m) + square(slice_m) / 12;
  const float told = variance > left_over ? variance - left_over : 0;

  float gain[kStates];
  for (uint8_t i = 0; i < kStates; ++i) gain[i] = covariance_[i][distance] / variance;
  // A wall that still has to prove straight learns from the gyro, and not the other way round (Schmidt 1966)
  const bool proven = wall.followed_m > config::kWallProof_m;
  const float told_yaw_m = proven ? off_m : 0;
  const Drift drift = {gain[kYaw] * told_yaw_m, gain[kBias] * told_yaw_m};
  if (!believable(drift)) {
    take_back();
    return;
  }
  for (uint8_t i = 0; i < kStates; ++i) {
    for (uint8_t k = 0; k < kStates; ++k) {
      if (proven || i >= kWalls || k >= kWalls) covariance_[i][k] -= gain[i] * gain[k] * told;
    }
  }
  for (uint8_t i = 0; i < 2; ++i) walls_[i].angle_rad -= gain[kWalls + 2 * i + 1] * off_m;
  for (uint8_t i = 0; i < 2; ++i) walls_[i].distance_m += gain[kWalls + 2 * i] * off_m;
  added_.yaw_rad += drift.yaw_rad;
  added_.rate_rad_s += drift.rate_rad_s;
}

}  // namespace core
