#include "retreat.h"

#include "fixed_point.h"

namespace core {

Retreat::Retreat() : oldest_(0), count_(0), here_(), cosine_q14_(0), sine_q14_(0) {}

void Retreat::forget_oldest() {
  oldest_ = static_cast<uint8_t>((oldest_ + 1) % kPlaces);
  --count_;
}

int32_t Retreat::behind_mm(const Place& place) const {
  return ((here_.x_mm - place.x_mm) * cosine_q14_ + (here_.y_mm - place.y_mm) * sine_q14_) / 16384;
}

int32_t Retreat::aside_mm(const Place& place) const {
  return ((here_.x_mm - place.x_mm) * sine_q14_ - (here_.y_mm - place.y_mm) * cosine_q14_) / 16384;
}

void Retreat::update(const Odometry& odometry) {
  here_.x_mm = odometry.x_mm();
  here_.y_mm = odometry.y_mm();
  ++here_.tick;
  cosine_q14_ = cosine_q14(odometry.yaw_cdeg());
  sine_q14_ = sine_q14(odometry.yaw_cdeg());
  const uint16_t fresh_ticks = config::kReverseFresh_ms / config::kTick_ms;
  while (count_ && static_cast<uint16_t>(here_.tick - place(0).tick) > fresh_ticks) forget_oldest();
  while (count_ && behind_mm(place(count_ - 1)) < 0) --count_;
  if (count_ && behind_mm(place(count_ - 1)) < config::kReverseStep_mm) return;
  if (count_ == kPlaces) forget_oldest();
  place(count_++) = here_;
}

int32_t Retreat::left_mm() const {
  int32_t left_mm = 0;
  for (uint8_t i = count_; i-- > 0;) {
    const int32_t behind = behind_mm(place(i));
    if (behind < left_mm || magnitude(aside_mm(place(i))) > config::kReverseAside_mm) break;
    left_mm = behind;
  }
  return left_mm;
}

int32_t Retreat::allowed(int32_t speed_mm_s) const {
  if (speed_mm_s >= 0) return speed_mm_s;
  return clamp(speed_mm_s, square_root(2u * config::kAcceleration_mm_s2 * static_cast<uint32_t>(left_mm())));
}

}  // namespace core
