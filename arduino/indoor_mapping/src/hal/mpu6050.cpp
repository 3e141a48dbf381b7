// MPU-6050 by its raw registers over the two-wire interface, all of it in interrupts. A transfer that fails or hangs
// frees the bus and sets the chip up anew. Clones answer the same registers; their identities differ.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>
#include <util/delay.h>
#include <util/twi.h>

#include "../config.h"
#include "mega.h"

namespace mega {
namespace {

const uint8_t kAddress = 0x68;
const uint8_t kWhoAmI = 0x75;
const uint8_t kFirstReading = 0x3B;
const uint8_t kReadingLength = 14;
const uint8_t kKnownChips[] = {0x68, 0x69, 0x70, 0x71, 0x72, 0x98};

struct Setting {
  uint8_t address, value;
};
const Setting kSettings[] = {
    {0x6B, 0x01},  // awake, clock from the gyro
    {0x1A, 0x03},  // low pass 42 Hz
    {0x1B, 0x08},  // +-500 deg/s
    {0x1C, 0x00},  // +-2 g
    {0x19, 0x04},  // 200 Hz
};
const uint8_t kSettingCount = sizeof(kSettings) / sizeof(kSettings[0]);

// Setting up: 0 asks for the identity, 1.. write the settings, then readings follow
volatile uint8_t g_stage;
volatile bool g_busy;
volatile uint8_t g_busy_ms, g_pause_ms;
volatile bool g_fresh;
hal::Imu g_reading;
uint8_t g_data[kReadingLength];
volatile uint8_t g_sent;
volatile uint8_t g_at, g_length;  // bytes read so far, bytes wanted; 0 wanted: a write

const uint8_t kGo = _BV(TWINT) | _BV(TWEN) | _BV(TWIE);

bool setting_up() { return g_stage <= kSettingCount; }

uint8_t register_address() {
  if (g_stage == 0) return kWhoAmI;
  return setting_up() ? kSettings[g_stage - 1].address : kFirstReading;
}

void start() {
  g_busy = true;
  g_busy_ms = 0;
  g_sent = g_at = 0;
  g_length = g_stage == 0 ? 1 : (setting_up() ? 0 : kReadingLength);
  TWCR = kGo | _BV(TWSTA);
}

int16_t word(uint8_t at) { return static_cast<int16_t>((g_data[at] << 8) | g_data[at + 1]); }

bool known_chip() {
  for (uint8_t i = 0; i < sizeof(kKnownChips); ++i) {
    if (g_data[0] == kKnownChips[i]) return true;
  }
  return false;
}

// False: a chip that has lost its power for a moment sleeps again and answers with noughts
bool take_reading() {
  hal::Imu r;
  r.ax = word(0);
  r.ay = word(2);
  r.az = word(4);
  r.gx = word(8);
  r.gy = word(10);
  r.gz = word(12);
  if (!r.ax && !r.ay && !r.az) return false;
  g_reading = r;
  g_fresh = true;
  return true;
}

void finish(bool good) {
  TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
  g_busy = false;
  if (good && g_stage == 0) good = known_chip();
  if (good && !setting_up()) good = take_reading();
  if (!good) {
    g_stage = 0;
  } else if (setting_up()) {
    ++g_stage;
  }
}

// A chip that was interrupted in the middle of a byte holds the data line: nine clocks let it finish
void free_bus() {
  TWCR = 0;
  for (uint8_t i = 0; i < 9; ++i) {
    DDRD |= _BV(PD0);
    _delay_us(3);
    DDRD &= static_cast<uint8_t>(~_BV(PD0));
    _delay_us(3);
  }
  g_busy = false;
  g_stage = 0;
}

// The register's address first; then its value, or the turn to reading
void send_next() {
  if (g_sent == 0) {
    TWDR = register_address();
    TWCR = kGo;
  } else if (g_length) {
    TWCR = kGo | _BV(TWSTA);
  } else if (g_sent == 1) {
    TWDR = kSettings[g_stage - 1].value;
    TWCR = kGo;
  } else {
    finish(true);
  }
  ++g_sent;
}

void answer() {
  switch (TW_STATUS) {
    case TW_START:
      TWDR = kAddress << 1 | TW_WRITE;
      TWCR = kGo;
      break;
    case TW_REP_START:
      TWDR = kAddress << 1 | TW_READ;
      TWCR = kGo;
      break;
    case TW_MT_SLA_ACK:
    case TW_MT_DATA_ACK:
      send_next();
      break;
    case TW_MR_DATA_ACK:
      g_data[g_at++] = TWDR;
      TWCR = g_at + 1 < g_length ? kGo | _BV(TWEA) : kGo;
      break;
    case TW_MR_SLA_ACK:
      TWCR = g_length > 1 ? kGo | _BV(TWEA) : kGo;
      break;
    case TW_MR_DATA_NACK:
      g_data[g_at] = TWDR;
      finish(g_at + 1 == g_length);
      break;
    default:
      finish(false);
      break;
  }
}

}  // namespace

void begin_imu() {
  PORTD |= _BV(PD0) | _BV(PD1);
  TWSR = 0;
  TWBR = (F_CPU / 400000ul - 16) / 2;
}

void tick_imu() {
  if (g_busy && ++g_busy_ms > config::kImuTimeout_ms) free_bus();
  if (++g_pause_ms < config::kImuPeriod_ms || g_busy) return;
  g_pause_ms = 0;
  start();
}

bool take_imu(hal::Imu* reading) {
  bool fresh = false;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    fresh = g_fresh;
    g_fresh = false;
    *reading = g_reading;
  }
  return fresh;
}

}  // namespace mega

ISR(TWI_vect) { mega::answer(); }
