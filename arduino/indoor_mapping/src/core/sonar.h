// Five sonars: firing order and echoes. Pulses in, millimetres out.
#pragma once
#include <stdint.h>

#include "../config.h"
#include "../hal/hal.h"

namespace core {

enum SonarName : uint8_t { kLeft, kFrontLeft, kFront, kFrontRight, kRight };

struct Distances {  // from the centre of the ring, 0 = no echo
  int32_t left_mm, right_mm, front_mm;
};

class Sonars {
 public:
  Sonars();
  void update(hal::Hal& hardware, uint32_t now_us);
  // From the transducer, 0 = no echo
  uint16_t range_mm(uint8_t sonar) const { return range_mm_[sonar]; }
  // Whether a reading of that sonar has come since the last call
  bool take_news(uint8_t sonar);
  // Since that sonar was fired for the reading
  uint16_t age_ms(uint8_t sonar, uint32_t now_us) const;
  // AggregateSonarData: distances to the walls left, right and in front
  Distances distances(uint32_t now_us) const;
  // A sonar in front sees something nearer to the footprint than the safe distance, and saw it near by a reading before:
  // out of nowhere it may be an early echo, and is asked for again first
  bool contact(uint32_t now_us) const;
  // No fresh reading in front is nearer to the footprint than the distance backing off ends at
  bool clear_in_front(uint32_t now_us) const;
  // A sonar has not answered its trigger for long
  bool silent() const;

 private:
  void fire_next(hal::Hal& hardware, uint32_t now_us);
  uint16_t fresh_mm(uint8_t sonar, uint32_t now_us) const;
  uint16_t range_mm_[config::kSonarCount];
  uint32_t measured_us_[config::kSonarCount];
  uint32_t fired_us_[config::kSonarCount];
  bool contact_[config::kSonarCount];
  bool news_[config::kSonarCount];
  bool heard_[config::kSonarCount];  // has a reading
  bool quiet_[config::kSonarCount];  // fired, but no pulse for long
  uint8_t group_;                    // fired last
  bool again_;                       // it is in doubt, and fired once more
  uint32_t next_us_;
  bool started_;
};

}  // namespace core
