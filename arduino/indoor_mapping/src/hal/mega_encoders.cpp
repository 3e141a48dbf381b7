// Wheel encoders: every edge of both channels counts (the specification's RightPulseInterrupt and LeftPulseInterrupt).
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/pgmspace.h>
#include <util/atomic.h>

#include "../config.h"
#include "mega.h"

namespace mega {
namespace {

struct Encoder {
  int32_t edges;
  uint8_t state;  // last levels: A in bit 1, B in bit 0
};

volatile Encoder g_left, g_right;

// Step from the old state (upper two bits) to the new one; A leads B forwards. Nothing, or both at once: no step
const int8_t kStep[16] PROGMEM = {0, -1, 1, 0, 1, 0, 0, -1, -1, 0, 0, 1, 0, 1, -1, 0};

inline uint8_t levels(uint8_t a, uint8_t b) { return static_cast<uint8_t>((a ? 2 : 0) | (b ? 1 : 0)); }

inline uint8_t left_levels() { return levels(PINE & _BV(config::kEncoderLeftA_E), PIND & _BV(config::kEncoderLeftB_D)); }

inline uint8_t right_levels() {
  return levels(PINE & _BV(config::kEncoderRightA_E), PIND & _BV(config::kEncoderRightB_D));
}

inline void count(volatile Encoder& encoder, uint8_t now) {
  const int8_t step = static_cast<int8_t>(pgm_read_byte(&kStep[(encoder.state << 2) | now]));
  encoder.state = now;
  encoder.edges = encoder.edges + step;
}

}  // namespace

void begin_encoders() {
  PORTE |= _BV(config::kEncoderLeftA_E) | _BV(config::kEncoderRightA_E);
  PORTD |= _BV(config::kEncoderLeftB_D) | _BV(config::kEncoderRightB_D);
  g_left.state = left_levels();
  g_right.state = right_levels();
  EICRA = _BV(ISC20) | _BV(ISC30);
  EICRB = _BV(ISC40) | _BV(ISC50);
  EIMSK = _BV(INT2) | _BV(INT3) | _BV(INT4) | _BV(INT5);
}

void read_encoders(int32_t* left, int32_t* right) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    *left = g_left.edges;
    *right = g_right.edges;
  }
  if (config::kLeftEncoderReversed) *left = -*left;
  if (config::kRightEncoderReversed) *right = -*right;
}

}  // namespace mega

ISR(INT4_vect) { mega::count(mega::g_left, mega::left_levels()); }
ISR(INT3_vect, ISR_ALIASOF(INT4_vect));
ISR(INT5_vect) { mega::count(mega::g_right, mega::right_levels()); }
ISR(INT2_vect, ISR_ALIASOF(INT5_vect));
