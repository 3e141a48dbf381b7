// Motor driver: PWM by timer 5 at 20.9 kHz, a direction pin each, and one enable line that wins over everything.
#include <avr/io.h>
#include <util/atomic.h>

#include "../config.h"
#include "mega.h"

namespace mega {
namespace {

const uint8_t kConnectLeft = _BV(COM5C1);
const uint8_t kConnectRight = _BV(COM5B1);

volatile uint8_t g_inhibited;

// With the compare output disconnected the pin falls back to the port's bit, which stays low
void turn(int16_t pwm, volatile uint16_t& compare, uint8_t connect, uint8_t direction_bit) {
  if (pwm == 0) {
    TCCR5A &= static_cast<uint8_t>(~connect);
    return;
  }
  if (pwm < 0) {
    PORTA |= direction_bit;
  } else {
    PORTA &= static_cast<uint8_t>(~direction_bit);
  }
  compare = static_cast<uint16_t>((pwm < 0 ? -pwm : pwm) * config::kPwmStep);
  TCCR5A |= connect;
}

}  // namespace

void begin_motors() {
  PORTA &= static_cast<uint8_t>(~(_BV(config::kDirLeft_A) | _BV(config::kDirRight_A) | _BV(config::kEnable_A)));
  DDRA |= _BV(config::kDirLeft_A) | _BV(config::kDirRight_A) | _BV(config::kEnable_A);
  PORTL &= static_cast<uint8_t>(~(_BV(config::kPwmLeft_L) | _BV(config::kPwmRight_L)));
  DDRL |= _BV(config::kPwmLeft_L) | _BV(config::kPwmRight_L);
  TCCR5B = 0;
  TCCR5A = _BV(WGM51);
  ICR5 = 255u * config::kPwmStep;
  TCCR5B = _BV(WGM53) | _BV(WGM52) | _BV(CS50);
}

void set_motors(int16_t left, int16_t right) {
  if (config::kLeftMotorReversed) left = static_cast<int16_t>(-left);
  if (config::kRightMotorReversed) right = static_cast<int16_t>(-right);
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    if (!g_inhibited) {
      turn(left, OCR5C, kConnectLeft, _BV(config::kDirLeft_A));
      turn(right, OCR5B, kConnectRight, _BV(config::kDirRight_A));
    }
  }
}

void enable_driver(bool on) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    if (on && !g_inhibited) {
      PORTA |= _BV(config::kEnable_A);
    } else {
      PORTA &= static_cast<uint8_t>(~_BV(config::kEnable_A));
    }
  }
}

void inhibit(uint8_t reason) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    PORTA &= static_cast<uint8_t>(~_BV(config::kEnable_A));
    TCCR5A &= static_cast<uint8_t>(~(kConnectLeft | kConnectRight));
    g_inhibited |= reason;
  }
}

void lift_inhibit(uint8_t reason) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { g_inhibited &= static_cast<uint8_t>(~reason); }
}

}  // namespace mega
