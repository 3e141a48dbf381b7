// Where the robot may drive backwards, as no sensor looks there: over floor that it drove over just now.
#pragma once
#include <stdint.h>

#include "../config.h"
#include "odometry.h"

namespace core {

// A trail of the places that the robot drove forwards over, in its own dead reckoning. A place is forgotten when it is
// old, when the trail gets longer than half a metre, and when it lies behind no more: driven back over, or turned away
// from. So no sequence of commands leads back beyond the trail.
class Retreat {
 public:
  Retreat();
  // Every control tick
  void update(const Odometry& odometry);
  // Of a speed in mm/s, forwards positive, as much as lets the robot stop where the trail behind it ends
  int32_t allowed(int32_t speed_mm_s) const;

 private:
  struct Place {
    int32_t x_mm, y_mm;
    uint16_t tick;
  };
  // One step less than may be driven back, for braking and for what the wheels misjudge
  static const uint8_t kPlaces = config::kReverseMax_mm / config::kReverseStep_mm - 1;
  Place& place(uint8_t i) { return trail_[(oldest_ + i) % kPlaces]; }
  const Place& place(uint8_t i) const { return trail_[(oldest_ + i) % kPlaces]; }
  void forget_oldest();
  int32_t behind_mm(const Place& place) const;
  int32_t aside_mm(const Place& place) const;
  int32_t left_mm() const;
  Place trail_[kPlaces];
  uint8_t oldest_, count_;
  Place here_;
  int32_t cosine_q14_, sine_q14_;
};

}  // namespace core
