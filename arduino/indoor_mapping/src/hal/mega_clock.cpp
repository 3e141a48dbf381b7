// Time: timer 1 runs freely at 2 MHz, timer 3 gives the millisecond tick. The Arduino core's own timer 0 is put to rest.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <util/atomic.h>

#include "../config.h"
#include "mega.h"

namespace mega {
namespace {

volatile uint32_t g_overflows;  // of timer 1, 32.768 ms each
volatile uint16_t g_battery;    // newest conversion
volatile bool g_ticked;

}  // namespace

void begin_clock() {
  TIMSK0 = 0;
  TCCR1A = TCCR3A = 0;
  TCCR1B = TCCR3B = 0;
  TCNT1 = TCNT3 = 0;
  // What the core's own settings have left behind is no overflow of ours
  TIFR1 = TIFR3 = 0xFF;
  OCR3A = 2000 - 1;
  TIMSK1 = _BV(TOIE1);
  TIMSK3 = _BV(OCIE3A);
  TCCR1B = _BV(CS11);
  TCCR3B = _BV(WGM32) | _BV(CS31);
  ADMUX = _BV(REFS0) | config::kBattery_F;
  ADCSRA = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
}

uint32_t micros() {
  uint16_t half_us;
  uint32_t overflows;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    half_us = TCNT1;
    overflows = g_overflows;
    // An overflow that still waits for its interrupt
    if ((TIFR1 & _BV(TOV1)) && half_us < 0x8000u) ++overflows;
  }
  return (overflows << 15) | (half_us >> 1);
}

uint16_t battery_mv() {
  uint16_t raw;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { raw = g_battery; }
  return static_cast<uint16_t>((static_cast<uint32_t>(raw) * config::kBatteryFull_mv) >> 10);
}

void sleep_until_tick() {
  set_sleep_mode(SLEEP_MODE_IDLE);
  cli();
  while (!g_ticked) {
    sleep_enable();
    sei();
    sleep_cpu();  // the instruction after sei() still comes before any interrupt
    sleep_disable();
    cli();
  }
  g_ticked = false;
  sei();
}

}  // namespace mega

ISR(TIMER1_OVF_vect) { mega::g_overflows = mega::g_overflows + 1; }

ISR(TIMER3_COMPA_vect) {
  mega::g_ticked = true;
  mega::watch_loop();
  mega::end_triggers();
  mega::tick_imu();
  if (!(ADCSRA & _BV(ADSC))) {
    mega::g_battery = ADC;
    ADCSRA |= _BV(ADSC);
  }
}
