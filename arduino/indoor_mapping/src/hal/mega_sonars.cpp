// Five MaxBotix sonars: a pulse on RX starts a ranging, the pin-change interrupt times the pulse on PW. Nothing waits.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "../config.h"
#include "mega.h"

namespace mega {
namespace {

const uint8_t kPulsePins = 0x1F;  // PB0 to PB4, the five of config::kSonarPulse_B
const uint8_t kTriggerPins = 0xF8;
const uint32_t kLongest_us = 60000;

volatile uint32_t g_rise_us[config::kSonarCount];
volatile uint16_t g_width_us[config::kSonarCount];
volatile uint8_t g_levels, g_risen, g_finished;  // one bit per sonar or pin
volatile uint8_t g_trigger_ms;

void edge(uint8_t sonar, bool high, uint32_t now_us) {
  const uint8_t bit = static_cast<uint8_t>(1 << sonar);
  if (high) {
    g_rise_us[sonar] = now_us;
    g_risen |= bit;
  } else if (g_risen & bit) {
    const uint32_t width_us = now_us - g_rise_us[sonar];
    g_width_us[sonar] = static_cast<uint16_t>(width_us < kLongest_us ? width_us : kLongest_us);
    g_risen &= static_cast<uint8_t>(~bit);
    g_finished |= bit;
  }
}

}  // namespace

void begin_sonars() {
  DDRC |= kTriggerPins;
  PORTC &= static_cast<uint8_t>(~kTriggerPins);
  g_levels = PINB;
  PCMSK0 = kPulsePins;
  PCICR |= _BV(PCIE0);
}

void trigger_sonars(uint8_t mask) {
  uint8_t pins = 0;
  for (uint8_t i = 0; i < config::kSonarCount; ++i) {
    if (mask & (1 << i)) pins |= static_cast<uint8_t>(1 << config::kSonarTrigger_C[i]);
  }
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    PORTC |= pins;
    g_trigger_ms = 2;  // the sonar wants at least 20 us; two ticks are at least 1 ms
  }
}

void end_triggers() {
  if (g_trigger_ms && --g_trigger_ms == 0) PORTC &= static_cast<uint8_t>(~kTriggerPins);
}

bool take_pulse(uint8_t sonar, uint16_t* width_us) {
  const uint8_t bit = static_cast<uint8_t>(1 << sonar);
  bool finished = false;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    finished = g_finished & bit;
    g_finished &= static_cast<uint8_t>(~bit);
    *width_us = g_width_us[sonar];
  }
  return finished;
}

}  // namespace mega

ISR(PCINT0_vect) {
  const uint8_t levels = PINB;
  const uint32_t now_us = mega::micros();
  const uint8_t changed = levels ^ mega::g_levels;
  mega::g_levels = levels;
  for (uint8_t i = 0; i < config::kSonarCount; ++i) {
    const uint8_t pin = static_cast<uint8_t>(1 << config::kSonarPulse_B[i]);
    if (changed & pin) mega::edge(i, levels & pin, now_us);
  }
}
