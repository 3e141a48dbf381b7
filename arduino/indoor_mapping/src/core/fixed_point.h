// Angles in 0.01 deg and a sine without floating point.
#pragma once
#include <stdint.h>

namespace core {

static const int32_t kTurn_cdeg = 36000;

inline int32_t clamp(int32_t value, int32_t limit) { return value > limit ? limit : (value < -limit ? -limit : value); }

inline int32_t magnitude(int32_t value) { return value < 0 ? -value : value; }

// The difference of two headings in [0, 36000), wrapped to [-18000, 18000)
inline int32_t wrap_cdeg(int32_t difference_cdeg) {
  if (difference_cdeg >= kTurn_cdeg / 2) return difference_cdeg - kTurn_cdeg;
  if (difference_cdeg < -kTurn_cdeg / 2) return difference_cdeg + kTurn_cdeg;
  return difference_cdeg;
}

// Towards `target` by at most `step`
inline int32_t approach(int32_t value, int32_t target, int32_t step) { return value + clamp(target - value, step); }

// sin times 16384 of an angle in 0.01 deg. Odd polynomial of fifth order, exact in value and slope at 0 and 90 deg;
// error below 5e-4.
inline int32_t sine_q14(int32_t angle_cdeg) {
  int32_t a = angle_cdeg % kTurn_cdeg;
  if (a < 0) a += kTurn_cdeg;
  const bool negative = a >= kTurn_cdeg / 2;
  if (negative) a -= kTurn_cdeg / 2;
  if (a > kTurn_cdeg / 4) a = kTurn_cdeg / 2 - a;
  const int32_t z = (a * 16384) / 9000;       // quarter turns, q14
  const int32_t z2 = (z * z) >> 14;
  // z (pi/2 - z^2 (pi - 5/2) + z^4 (pi/2 - 3/2))
  int32_t s = 10512 - ((z2 * 1160) >> 14);
  s = 25736 - ((z2 * s) >> 14);
  s = (z * s) >> 14;
  return negative ? -s : s;
}

inline int32_t cosine_q14(int32_t angle_cdeg) { return sine_q14(angle_cdeg + kTurn_cdeg / 4); }

inline int32_t square_root(uint32_t value) {
  uint32_t root = 0;
  for (uint32_t bit = 1ul << 30; bit; bit >>= 2) {
    if (value >= root + bit) {
      value -= root + bit;
      root = (root >> 1) + bit;
    } else {
      root >>= 1;
    }
  }
  return static_cast<int32_t>(root);
}

// atan2 in 0.01 deg, in (-18000, 18000]; both arguments below 2^17. Within 0.25 deg (Rajan et al., "Efficient
// approximations for the arctangent function", IEEE Signal Processing Magazine 23, 2006).
inline int32_t arctangent_cdeg(int32_t y, int32_t x) {
  const int32_t up = magnitude(y), along = magnitude(x);
  const int32_t longer = up > along ? up : along;
  if (longer == 0) return 0;
  const int32_t z = ((up > along ? along : up) * 16384) / longer;
  int32_t angle = (z * (4500 + ((1564 * (16384 - z)) >> 14))) >> 14;
  if (up > along) angle = kTurn_cdeg / 4 - angle;
  if (x < 0) angle = kTurn_cdeg / 2 - angle;
  return y < 0 ? -angle : angle;
}

}  // namespace core
