// Why it started, the watchdog, and the check that the loop still comes round. The check turns the motors off and writes
// its cause down; the watchdog then restarts the chip. It runs in its plain reset mode: with its own interrupt enabled,
// a loop that hangs with interrupts off would never be reset.
#include <avr/eeprom.h>
#include <avr/io.h>
#include <avr/wdt.h>

#include "../config.h"
#include "../core/protocol.h"
#include "mega.h"

namespace mega {
namespace {

// Survives every restart but the loss of power
struct Memory {
  uint16_t mark;
  bool stuck;
};
const uint16_t kMark = 0x5EA1;
Memory g_memory __attribute__((section(".noinit")));
uint8_t g_flags __attribute__((section(".noinit")));  // MCUSR as it was
uint16_t EEMEM g_sessions;
uint8_t EEMEM g_stopped;
const uint8_t kStopped = 0x5A;  // neither erased nor zero

volatile uint8_t g_loop_age_ms;
volatile bool g_stuck;
uint8_t g_cause;

// The bootloader of the Mega clears MCUSR: then only the memory tells
uint8_t find_cause() {
  const bool kept = g_memory.mark == kMark;
  if (g_flags & _BV(PORF)) return core::RESET_CAUSE_POWER_ON;
  if (g_flags & _BV(BORF)) return core::RESET_CAUSE_BROWN_OUT;
  if ((g_flags & _BV(WDRF)) || (kept && g_memory.stuck)) return core::RESET_CAUSE_WATCHDOG;
  return kept || (g_flags & _BV(EXTRF)) ? core::RESET_CAUSE_EXTERNAL : core::RESET_CAUSE_POWER_ON;
}

}  // namespace

uint8_t reset_cause() { return g_cause; }

uint16_t begin_session() {
  g_cause = find_cause();
  g_memory.mark = kMark;
  g_memory.stuck = false;
  const uint16_t session = static_cast<uint16_t>(eeprom_read_word(&g_sessions) + 1);
  eeprom_update_word(&g_sessions, session);
  return session;
}

bool stop_kept() { return eeprom_read_byte(&g_stopped) == kStopped; }

// Returns at once: the chip writes by itself
void keep_stop(bool kept) { eeprom_update_byte(&g_stopped, kept ? kStopped : 0xFF); }

void watch_loop() {
  if (++g_loop_age_ms < config::kLoopLockup_ms) return;
  g_loop_age_ms = config::kLoopLockup_ms;
  inhibit(kLoopStuck);
  g_memory.stuck = true;
  g_stuck = true;
}

void loop_alive() {
  g_loop_age_ms = 0;
  // A loop that stood still once is not trusted again: without this the watchdog ends it
  if (!g_stuck) wdt_reset();
}

void begin_watchdog() { wdt_enable(WDTO_120MS); }

}  // namespace mega

// Before main, and before the variables are set: a watchdog that has just struck still runs, with 16 ms
extern "C" void after_reset(void) __attribute__((naked, used, section(".init3")));
extern "C" void after_reset(void) {
  mega::g_flags = MCUSR;
  MCUSR = 0;
  wdt_disable();
}
