#include "odometry.h"

#include "fixed_point.h"

namespace core {
namespace {

// One degree of yaw: 65.5 counts * 2^8 * 10^6 us
const int64_t kDegree = static_cast<int64_t>(config::kGyroLsbPer10Dps) * 256 * 100000;
const float kRadianPerSecond_q16 = config::kGyroLsbPer10Dps * 5.729578f * 65536;  // counts
const int64_t kFullTurn = kDegree * 360;
// A sample's own variance is 1 (q16: 65536); the bias walks by 1/65536 of it per sample
const uint32_t kBiasWalk_q16 = 1;
// Eight standard deviations, and the sensor may be noisier than thought
const float kWanderMax = 64;
const uint32_t kWanderSlack_q16 = 655;
const uint8_t kControlWindow = 4;
const uint8_t kReportWindow = 10;

// (rad/s)^2
float sample_variances(uint32_t many_q16) {
  return many_q16 / 65536.0f * config::kGyroNoise_rad_s * config::kGyroNoise_rad_s;
}

uint16_t add_capped(uint16_t value, uint32_t more) {
  const uint32_t sum = value + more;
  return static_cast<uint16_t>(sum < 60000u ? sum : 60000u);
}

}  // namespace

Gyro::Gyro()
    : calibrated_(false), boot_count_(0), boot_sum_(0), boot_low_(0), boot_high_(0), now_(), before_(),
      turned_(false), rate_q16_(0) {}

void Gyro::calibrate(int16_t raw, bool still) {
  if (!still) {
    boot_count_ = 0;
    return;
  }
  if (boot_count_ == 0) {
    boot_sum_ = 0;
    boot_low_ = boot_high_ = raw;
  }
  if (raw < boot_low_) boot_low_ = raw;
  if (raw > boot_high_) boot_high_ = raw;
  if (static_cast<int32_t>(boot_high_) - boot_low_ > config::kGyroBootSpread_lsb) {
    boot_count_ = 0;
    return;
  }
  boot_sum_ += raw;
  ++boot_count_;
  if (boot_count_ < config::kGyroBootSamples) return;
  now_.bias_q16 = static_cast<int32_t>(static_cast<int64_t>(boot_sum_) * 65536 / boot_count_);
  now_.variance_q16 = 65536u / boot_count_;
  before_ = now_;
  calibrated_ = true;
}

void Gyro::track_bias() {
  const float spread = 1 + now_.variance_q16 / 65536.0f;
  now_.with_yaw_s /= spread;
  // q16 to q8 and s to us
  turn(-static_cast<int64_t>(now_.with_yaw_s * (1e6f / 256) * rate_q16_));
  now_.variance_q16 = static_cast<uint32_t>(now_.variance_q16 / spread);
  now_.bias_q16 += static_cast<int32_t>((static_cast<int64_t>(rate_q16_) * now_.variance_q16) >> 16);
}

bool Gyro::wandered_too_far() const {
  const float change = (now_.bias_q16 - before_.bias_q16) / kRadianPerSecond_q16;
  return change * change > kWanderMax * sample_variances(before_.variance_q16 + kWanderSlack_q16);
}

void Gyro::sample(int16_t raw, uint32_t dt_us, bool still) {
  if (!calibrated_) {
    calibrate(raw, still);
    return;
  }
  if (now_.variance_q16 < 65536u) now_.variance_q16 += kBiasWalk_q16;
  if (before_.variance_q16 < 65536u) before_.variance_q16 += kBiasWalk_q16;
  if (!still) now_.with_yaw_s += now_.variance_q16 / 65536.0f * dt_us * 1e-6f;
  const int32_t rate_before_q16 = rate_q16_;
  rate_q16_ = static_cast<int32_t>(raw) * 65536 - now_.bias_q16;
  if (still && !turned_ && magnitude(rate_q16_) < config::kGyroStillGate_lsb * 65536) {
    // Standing still the rate is known: it is nought, and what the gyro shows is its bias
    track_bias();
    turned_ = wandered_too_far();
    if (!turned_) {
      rate_q16_ = 0;
      return;
    }
    now_ = before_;
  }
  // Trapezoid; halved to q8 of counts
  turn(static_cast<int64_t>((rate_before_q16 >> 9) + (rate_q16_ >> 9)) * dt_us);
  if (still) return;
  before_ = now_;
  turned_ = false;
}

void Gyro::turn(int64_t angle) {
  now_.yaw += angle;
  if (now_.yaw >= kFullTurn) now_.yaw -= kFullTurn;
  if (now_.yaw < 0) now_.yaw += kFullTurn;
}

float Gyro::bias_variance() const {
  return sample_variances(now_.variance_q16);
}

int32_t Gyro::yaw_cdeg() const { return static_cast<int32_t>(now_.yaw / (kDegree / 100)); }

int32_t Gyro::rate_cdps() const { return (rate_q16_ >> 8) * 125 / (config::kGyroLsbPer10Dps * 32); }

Odometry::Odometry()
    : left_(0), right_(0), head_(0), last_us_(0), last_gyro_cdeg_(0), last_yaw_cdeg_(0), x_nm_(0), y_nm_(0),
      still_ms_(0), imu_silent_ms_(0), motors_off_(true), first_(true) {
  for (uint8_t i = 0; i < kHistory; ++i) {
    history_left_[i] = history_right_[i] = 0;
    history_us_[i] = 0;
  }
}

void Odometry::update(hal::Hal& hardware, uint32_t now_us, bool motors_off) {
  const uint32_t dt_us = first_ ? config::kTick_ms * 1000ul : now_us - last_us_;
  first_ = false;
  last_us_ = now_us;
  motors_off_ = motors_off;

  int32_t left, right;
  hardware.encoders(&left, &right);
  const int32_t moved = (left - left_) + (right - right_);
  const bool turned = left != left_ || right != right_;
  left_ = left;
  right_ = right;
  still_ms_ = turned ? 0 : add_capped(still_ms_, dt_us / 1000u);
  head_ = static_cast<uint8_t>((head_ + 1) % kHistory);
  history_left_[head_] = left;
  history_right_[head_] = right;
  history_us_[head_] = now_us;

  hal::Imu reading;
  if (hardware.imu(&reading)) {
    imu_silent_ms_ = 0;
    gyro_.sample(reading.gz, dt_us, standing());
    tilt_.sample(reading.ax, reading.ay, reading.az);
  } else {
    imu_silent_ms_ = add_capped(imu_silent_ms_, dt_us / 1000u);
  }

  const int32_t gyro_cdeg = gyro_.yaw_cdeg(), gyro_turn_cdeg = wrap_cdeg(gyro_cdeg - last_gyro_cdeg_);
  last_gyro_cdeg_ = gyro_cdeg;
  const int32_t now_cdeg = yaw_cdeg(), turn_cdeg = wrap_cdeg(now_cdeg - last_yaw_cdeg_);
  if (standing() && !gyro_.turned()) {
    walls_.stand(gyro_.bias_variance(), gyro_turn_cdeg);
  } else {
    walls_.move(dt_us, moved, turn_cdeg);
  }
  if (moved) {
    const int32_t middle_cdeg = last_yaw_cdeg_ + turn_cdeg / 2;
    const int64_t distance_nm = static_cast<int64_t>(moved) * (config::kTick_nm / 2);
    x_nm_ += (distance_nm * cosine_q14(middle_cdeg)) / 16384;
    y_nm_ += (distance_nm * sine_q14(middle_cdeg)) / 16384;
  }
  last_yaw_cdeg_ = now_cdeg;
}

int32_t Odometry::yaw_cdeg() const {
  const int32_t yaw_cdeg = wrap_cdeg(gyro_.yaw_cdeg() + walls_.yaw_cdeg());
  return yaw_cdeg < 0 ? yaw_cdeg + 36000 : yaw_cdeg;
}

int32_t Odometry::window_speed_q8(int32_t ticks, uint8_t back) const {
  const uint8_t old = static_cast<uint8_t>((head_ + kHistory - back) % kHistory);
  const int32_t dt_16us = static_cast<int32_t>((history_us_[head_] - history_us_[old]) / 16u);
  if (dt_16us <= 0) return 0;
  // ticks * tick_nm * 256 / dt; the constant is tick_nm * 256 / 16
  return ticks * (config::kTick_nm * 16) / dt_16us;
}

int32_t Odometry::wheel_speed_q8(bool right) const {
  const uint8_t old = static_cast<uint8_t>((head_ + kHistory - kControlWindow) % kHistory);
  const int32_t ticks = right ? right_ - history_right_[old] : left_ - history_left_[old];
  return window_speed_q8(clamp(ticks, 400), kControlWindow);
}

int32_t Odometry::speed_mm_s() const {
  const uint8_t old = static_cast<uint8_t>((head_ + kHistory - kReportWindow) % kHistory);
  const int32_t ticks = (left_ - history_left_[old]) + (right_ - history_right_[old]);
  return window_speed_q8(clamp(ticks, 900), kReportWindow) / 512;
}

}  // namespace core
