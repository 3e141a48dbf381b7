#include "sonar.h"

namespace core {
namespace {

// Opposite sonars do not receive each other's echoes; neighbours would
const uint8_t kGroups = 3;
const uint8_t kGroupMask[kGroups] = {
    (1 << kLeft) | (1 << kRight),
    (1 << kFrontLeft) | (1 << kFrontRight),
    1 << kFront,
};
const uint16_t kNever_ms = 0xFFFF;
const int32_t kSine45_q8 = 181;

// 147 us per inch, rounded
uint16_t pulse_to_mm(uint16_t width_us) {
  return static_cast<uint16_t>((static_cast<uint32_t>(width_us) * 254u + 735u) / 1470u);
}

// Readings of the transducer for a gap between footprint and thing
const int32_t kContact_mm = config::kHullRadius_mm + config::kSafeDistance_mm - config::kSonarRingRadius_mm;
const int32_t kClear_mm = config::kHullRadius_mm + config::kClearDistance_mm - config::kSonarRingRadius_mm;

bool within(uint16_t reading_mm, int32_t limit_mm) { return reading_mm && reading_mm < limit_mm; }

int32_t from_centre(uint16_t reading_mm) { return reading_mm ? reading_mm + config::kSonarRingRadius_mm : 0; }

// The angled sonar is a second witness of the wall beside it, where its echo came from there
int32_t merge(int32_t straight_mm, int32_t angled_mm) {
  if (!angled_mm) return straight_mm;
  if (!straight_mm) return angled_mm;
  const int32_t apart = straight_mm > angled_mm ? straight_mm - angled_mm : angled_mm - straight_mm;
  return apart * 8 > straight_mm ? straight_mm : (straight_mm + angled_mm) / 2;
}

int32_t nearer(int32_t a_mm, int32_t b_mm) {
  if (!a_mm) return b_mm;
  if (!b_mm) return a_mm;
  return a_mm < b_mm ? a_mm : b_mm;
}

}  // namespace

Sonars::Sonars() : group_(kGroups - 1), again_(false), next_us_(0), started_(false) {
  for (uint8_t i = 0; i < config::kSonarCount; ++i) {
    range_mm_[i] = 0;
    measured_us_[i] = 0;
    fired_us_[i] = 0;
    contact_[i] = news_[i] = heard_[i] = quiet_[i] = false;
  }
}

void Sonars::update(hal::Hal& hardware, uint32_t now_us) {
  for (uint8_t i = 0; i < config::kSonarCount; ++i) {
    uint16_t width_us = 0;
    if (!hardware.echo(i, &width_us) || !started_) continue;
    const bool was_near = within(range_mm_[i], kContact_mm + config::kApproach_mm);
    range_mm_[i] = width_us >= config::kSonarNothing_us ? 0 : pulse_to_mm(width_us);
    measured_us_[i] = fired_us_[i];
    news_[i] = heard_[i] = true;
    quiet_[i] = false;
    const bool too_near = within(range_mm_[i], kContact_mm);
    contact_[i] = too_near && was_near;
    if (too_near && !was_near && i >= kFrontLeft && i <= kFrontRight) again_ = true;
  }
  fire_next(hardware, now_us);
  for (uint8_t i = 0; started_ && i < config::kSonarCount; ++i) {
    if (now_us - measured_us_[i] <= config::kSonarSilent_ms * 1000ul) continue;
    quiet_[i] = true;
    contact_[i] = heard_[i] = false;
  }
}

void Sonars::fire_next(hal::Hal& hardware, uint32_t now_us) {
  if (!started_) {
    if (now_us < config::kSonarPowerUp_ms * 1000ul) return;
    started_ = true;
    next_us_ = now_us;
    for (uint8_t i = 0; i < config::kSonarCount; ++i) fired_us_[i] = measured_us_[i] = now_us;
  }
  if (static_cast<int32_t>(now_us - next_us_) < 0) return;
  if (!again_) group_ = static_cast<uint8_t>((group_ + 1) % kGroups);
  again_ = false;
  const uint8_t mask = kGroupMask[group_];
  hardware.fire(mask);
  for (uint8_t i = 0; i < config::kSonarCount; ++i) {
    if (mask & (1 << i)) fired_us_[i] = now_us;
  }
  next_us_ += config::kSonarCycle_ms * 1000ul;
  if (static_cast<int32_t>(now_us - next_us_) > 0) next_us_ = now_us + config::kSonarCycle_ms * 1000ul;
}

bool Sonars::take_news(uint8_t sonar) {
  const bool news = news_[sonar];
  news_[sonar] = false;
  return news;
}

uint16_t Sonars::age_ms(uint8_t sonar, uint32_t now_us) const {
  if (!heard_[sonar]) return kNever_ms;
  const uint32_t age_ms = (now_us - measured_us_[sonar]) / 1000u;
  return age_ms < kNever_ms ? static_cast<uint16_t>(age_ms) : kNever_ms;
}

uint16_t Sonars::fresh_mm(uint8_t sonar, uint32_t now_us) const {
  const bool fresh = heard_[sonar] && now_us - measured_us_[sonar] < (config::kSonarAgeMax_ms + 1) * 1000ul;
  return fresh ? range_mm_[sonar] : 0;
}

Distances Sonars::distances(uint32_t now_us) const {
  Distances d;
  d.left_mm = from_centre(fresh_mm(kLeft, now_us));
  d.right_mm = from_centre(fresh_mm(kRight, now_us));
  d.front_mm = from_centre(fresh_mm(kFront, now_us));
  // At 45 deg an echo lies as far ahead as aside: in the robot's way it counts for the front, else for its side
  const int32_t aside_left = (from_centre(fresh_mm(kFrontLeft, now_us)) * kSine45_q8) >> 8;
  const int32_t aside_right = (from_centre(fresh_mm(kFrontRight, now_us)) * kSine45_q8) >> 8;
  const int32_t lane = config::kHullRadius_mm + config::kSafeDistance_mm;
  if (aside_left <= lane) {
    d.front_mm = nearer(d.front_mm, aside_left);
  } else {
    d.left_mm = merge(d.left_mm, aside_left);
  }
  if (aside_right <= lane) {
    d.front_mm = nearer(d.front_mm, aside_right);
  } else {
    d.right_mm = merge(d.right_mm, aside_right);
  }
  return d;
}

bool Sonars::contact(uint32_t now_us) const {
  for (uint8_t i = kFrontLeft; i <= kFrontRight; ++i) {
    if (contact_[i] && fresh_mm(i, now_us)) return true;
  }
  return false;
}

bool Sonars::clear_in_front(uint32_t now_us) const {
  for (uint8_t i = kFrontLeft; i <= kFrontRight; ++i) {
    if (within(fresh_mm(i, now_us), kClear_mm)) return false;
  }
  return true;
}

bool Sonars::silent() const {
  for (uint8_t i = 0; i < config::kSonarCount; ++i) {
    if (quiet_[i]) return true;
  }
  return false;
}

}  // namespace core
