// The firmware's own binary for the Arduino Mega inside simavr, with the pins tied to a simulated body.
// A C interface for offboard/simulator/electronics/avr_board.py; one call advances the microcontroller to a point in time.
//
// SPDX-License-Identifier: GPL-3.0-or-later
// This file links simavr, which is under the GNU GPL 3: unlike the rest of the project it is under the GPL too. It is a
// tool for tests and simulations; nothing of it goes onto the robot.
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <deque>
#include <map>
#include <queue>
#include <vector>

extern "C" {
#include <avr_adc.h>
#include <avr_ioport.h>
#include <avr_twi.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_elf.h>
#include <sim_hex.h>
#include <sim_interrupts.h>
}

#include "../indoor_mapping/src/config.h"

namespace {

const uint32_t kCyclesPer_us = 16;
const uint32_t kTxSize = 65536;
const uint32_t kBootStart = 0x3E000;
const uint32_t kRamStart = 0x200;
const uint8_t kPaint = 0xC5;
const uint8_t kImuAddress = 0x68;

// Registers of the ATmega2560, as addresses of data
const int kConnectLeft = 2, kConnectRight = 4;  // lower bit of each compare output in TCCR5A

enum Register {
  kDdrA = 0x21, kPortA = 0x22, kMcusr = 0x54, kTwcr = 0xBC,
  kDdrL = 0x10A, kPortL = 0x10B, kTccr5a = 0x120, kOcr5b = 0x12A, kOcr5c = 0x12C,
};

struct Edge {
  uint64_t at, order;
  char port;
  uint8_t pin, level;
};

struct Later {
  bool operator()(const Edge& a, const Edge& b) const { return a.at != b.at ? a.at > b.at : a.order > b.order; }
};

void only_errors(avr_t*, int level, const char* format, va_list arguments) {
  if (level <= LOG_ERROR) vfprintf(stderr, format, arguments);
}

}  // namespace

extern "C" {

// Shared with Python, which reads its fields after each call of avr_board_run
struct AvrOutputs {
  int32_t pwm_left, pwm_right;
  int32_t enabled;
  uint32_t fired;       // sonars triggered since they were last taken, one bit each
  uint32_t resets;      // by the watchdog
  uint32_t latency;     // worst so far, in cycles: from an interrupt's cause to its first instruction
  uint64_t cycles, asleep, interrupts;  // since power-on: all, sleeping, in interrupts
  uint32_t tx_length;   // bytes waiting in tx
  char tx[kTxSize];
};

struct AvrBoard {
  avr_t* avr;
  AvrOutputs out;
  uint64_t power_on, target, edges_ever;
  std::priority_queue<Edge, std::vector<Edge>, Later> edges;
  std::deque<uint8_t> to_avr;
  bool line_free, restore;
  avr_irq_t *uart_in, *twi_in;
  void (*core_reset)(avr_t*);
  uint8_t driven[12], levels[12];  // ports A to L
  uint8_t phase[2];
  uint8_t registers[128];
  uint8_t pointer;
  bool imu_answers, selected, pointer_known;
  uint32_t battery_mv;
  uint64_t pending_since[64], running_since;
  bool imu_hangs;
};

}  // extern "C"

namespace {

std::map<avr_t*, AvrBoard*>& boards() {  // the reset hook carries nothing else
  static std::map<avr_t*, AvrBoard*> all;
  return all;
}

void drive(AvrBoard* b, char port, int pin, int level) {
  uint8_t& levels = b->levels[port - 'A'];
  uint8_t& driven = b->driven[port - 'A'];
  levels = static_cast<uint8_t>(level ? levels | 1 << pin : levels & ~(1 << pin));
  driven = static_cast<uint8_t>(driven | 1 << pin);
  // Without this simavr 1.6 pulls inputs with pull-up back to 1 whenever the firmware writes the same port
  avr_ioport_external_t external;
  memset(&external, 0, sizeof external);
  external.mask = driven;
  external.value = levels;
  avr_ioctl(b->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &external);
  avr_raise_irq(avr_io_getirq(b->avr, AVR_IOCTL_IOPORT_GETIRQ(port), pin), level);
}

avr_cycle_count_t due_edges(avr_t* avr, avr_cycle_count_t, void* parameter) {
  AvrBoard* b = static_cast<AvrBoard*>(parameter);
  while (!b->edges.empty() && b->edges.top().at <= avr->cycle) {
    const Edge edge = b->edges.top();
    b->edges.pop();
    drive(b, edge.port, edge.pin, edge.level);
  }
  return b->edges.empty() ? 0 : b->edges.top().at;
}

// Its only use is to end avr_run at the right cycle
avr_cycle_count_t step_end(avr_t*, avr_cycle_count_t, void*) { return 0; }

void plan(AvrBoard* b, char port, int pin, int level, uint64_t at) {
  b->edges.push(Edge{at, b->edges_ever++, port, static_cast<uint8_t>(pin), static_cast<uint8_t>(level)});
}

void arm(AvrBoard* b) {
  if (!b->edges.empty()) {
    const uint64_t at = b->edges.top().at;
    avr_cycle_timer_register(b->avr, at > b->avr->cycle ? at - b->avr->cycle : 1, due_edges, b);
  }
  if (b->avr->cycle < b->target) avr_cycle_timer_register(b->avr, b->target - b->avr->cycle, step_end, b);
  b->avr->run_cycle_limit = 4096;
}

void pump(AvrBoard* b) {
  while (b->line_free && !b->to_avr.empty()) {
    const uint8_t byte = b->to_avr.front();
    b->to_avr.pop_front();
    avr_raise_irq(b->uart_in, byte);
  }
}

void on_sent(avr_irq_t*, uint32_t value, void* parameter) {
  AvrOutputs& out = static_cast<AvrBoard*>(parameter)->out;
  if (out.tx_length < kTxSize) out.tx[out.tx_length++] = static_cast<char>(value);
}

void on_line_free(avr_irq_t*, uint32_t, void* parameter) {
  AvrBoard* b = static_cast<AvrBoard*>(parameter);
  b->line_free = true;
  pump(b);
}

void on_line_full(avr_irq_t*, uint32_t value, void* parameter) {
  if (value) static_cast<AvrBoard*>(parameter)->line_free = false;
}

void on_trigger(avr_irq_t* irq, uint32_t value, void* parameter) {
  if (!value) return;
  for (int i = 0; i < config::kSonarCount; ++i) {
    if (irq->irq == config::kSonarTrigger_C[i]) static_cast<AvrBoard*>(parameter)->out.fired |= 1u << i;
  }
}

void imu_power_on(AvrBoard* b) {
  memset(b->registers, 0, sizeof b->registers);
  b->registers[0x75] = kImuAddress;
  b->registers[0x6B] = 0x40;  // asleep
}

uint8_t imu_register(const AvrBoard* b, uint8_t address) {
  const bool reading = address >= 0x3B && address < 0x49;
  return reading && (b->registers[0x6B] & 0x40) ? 0 : b->registers[address];
}

// The MPU-6050 as a slave on the two-wire interface
void on_twi(avr_irq_t*, uint32_t value, void* parameter) {
  AvrBoard* b = static_cast<AvrBoard*>(parameter);
  avr_twi_msg_irq_t message;
  message.u.v = value;
  const uint8_t kind = message.u.twi.msg;
  if (kind & TWI_COND_STOP) b->selected = false;
  if (kind & TWI_COND_START) {
    b->selected = b->imu_answers && message.u.twi.addr >> 1 == kImuAddress;
    b->pointer_known = false;
    if (b->imu_hangs) b->avr->data[kTwcr] &= static_cast<uint8_t>(~1);
    b->imu_hangs = false;
    if (b->selected) avr_raise_irq(b->twi_in, avr_twi_irq_msg(TWI_COND_ACK, message.u.twi.addr, 1));
  }
  if (!b->selected) return;
  if (kind & TWI_COND_WRITE) {
    avr_raise_irq(b->twi_in, avr_twi_irq_msg(TWI_COND_ACK, message.u.twi.addr, 1));
    if (b->pointer_known) b->registers[b->pointer++ & 127] = message.u.twi.data;
    if (!b->pointer_known) b->pointer = message.u.twi.data;
    b->pointer_known = true;
  }
  if (kind & TWI_COND_READ) {
    const uint8_t data = imu_register(b, b->pointer++ & 127);
    avr_raise_irq(b->twi_in, avr_twi_irq_msg(TWI_COND_READ, message.u.twi.addr, data));
  }
}

void on_pending(avr_irq_t* irq, uint32_t value, void* parameter) {
  AvrBoard* b = static_cast<AvrBoard*>(parameter);
  if (value) b->pending_since[irq->irq >> 8 & 63] = b->avr->cycle;
}

void on_running(avr_irq_t* irq, uint32_t value, void* parameter) {
  AvrBoard* b = static_cast<AvrBoard*>(parameter);
  if (!value) {
    b->out.interrupts += b->avr->cycle - b->running_since;
    return;
  }
  b->running_since = b->avr->cycle;
  uint64_t& since = b->pending_since[irq->irq >> 8 & 63];
  if (!since) return;
  const uint32_t latency = static_cast<uint32_t>(b->avr->cycle - since);
  if (latency > b->out.latency) b->out.latency = latency;
  since = 0;
}

void on_reset(avr_t* avr) {
  AvrBoard* b = boards().at(avr);
  if (b->core_reset) b->core_reset(avr);
  ++b->out.resets;
  b->line_free = true;
  // The reset wiped the cycle timers and the pins' levels: both come back once it is over
  b->restore = true;
}

// All four channels high: simavr 1.6 asks an interrupt pin that is low on every cycle until its next edge, because after
// a reset it is set to level mode. Where the wheels stand the firmware takes as it is
void rest_encoders(AvrBoard* b) {
  b->phase[0] = b->phase[1] = 2;
  drive(b, 'E', config::kEncoderLeftA_E, 1);
  drive(b, 'E', config::kEncoderRightA_E, 1);
  drive(b, 'D', config::kEncoderLeftB_D, 1);
  drive(b, 'D', config::kEncoderRightB_D, 1);
}

void set_battery(AvrBoard* b) {
  avr_raise_irq(avr_io_getirq(b->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0),
                b->battery_mv * 5000 / config::kBatteryFull_mv);
}

void restore(AvrBoard* b) {
  b->restore = false;
  b->levels['E' - 'A'] = b->levels['D' - 'A'] = 0xFF;
  for (char port = 'A'; port <= 'L'; ++port) {
    for (int pin = 0; pin < 8; ++pin) {
      if (!(b->driven[port - 'A'] >> pin & 1)) continue;
      const int level = b->levels[port - 'A'] >> pin & 1;
      // simavr passes on changes only
      avr_io_getirq(b->avr, AVR_IOCTL_IOPORT_GETIRQ(port), pin)->value = level ? 0 : 1;
      drive(b, port, pin, level);
    }
  }
  b->phase[0] = b->phase[1] = 2;
  set_battery(b);
  memset(b->pending_since, 0, sizeof b->pending_since);
  arm(b);
}

void slept(avr_t* avr, avr_cycle_count_t cycles) { boards().at(avr)->out.asleep += cycles; }

int pwm(const AvrBoard* b, int pin, int compare, int connect_bits, int direction_pin) {
  const uint8_t* data = b->avr->data;
  if (!(data[kDdrL] >> pin & 1)) return 0;
  int value = (data[kPortL] >> pin & 1) * 255;
  if (data[kTccr5a] >> connect_bits & 3) value = (data[compare] | data[compare + 1] << 8) / config::kPwmStep;
  return data[kPortA] >> direction_pin & 1 ? -value : value;
}

void look(AvrBoard* b) {
  const uint8_t* data = b->avr->data;
  b->out.pwm_left = pwm(b, config::kPwmLeft_L, kOcr5c, kConnectLeft, config::kDirLeft_A);
  b->out.pwm_right = pwm(b, config::kPwmRight_L, kOcr5b, kConnectRight, config::kDirRight_A);
  b->out.enabled = data[kDdrA] >> config::kEnable_A & data[kPortA] >> config::kEnable_A & 1;
  b->out.cycles = b->avr->cycle;
}

void connect(AvrBoard* b) {
  avr_t* avr = b->avr;
  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
  flags &= ~static_cast<uint32_t>(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  const uint32_t uart = AVR_IOCTL_UART_GETIRQ('0');
  b->uart_in = avr_io_getirq(avr, uart, UART_IRQ_INPUT);
  avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUTPUT), on_sent, b);
  avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUT_XON), on_line_free, b);
  avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUT_XOFF), on_line_full, b);
  b->twi_in = avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_INPUT);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_OUTPUT), on_twi, b);
  for (int i = 0; i < config::kSonarCount; ++i) {
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('C'), config::kSonarTrigger_C[i]), on_trigger, b);
    drive(b, 'B', config::kSonarPulse_B[i], 0);
  }
  rest_encoders(b);
  for (int i = 0; i < avr->interrupts.vector_count; ++i) {
    const uint8_t vector = avr->interrupts.vector[i]->vector;
    avr_irq_register_notify(avr_get_interrupt_irq(avr, vector) + AVR_INT_IRQ_PENDING, on_pending, b);
    avr_irq_register_notify(avr_get_interrupt_irq(avr, vector) + AVR_INT_IRQ_RUNNING, on_running, b);
  }
}

bool load_bootloader(avr_t* avr, const char* hex) {
  ihex_chunk_p chunks = nullptr;
  const int count = read_ihex_chunks(hex, &chunks);
  if (count <= 0) return false;
  for (int i = 0; i < count; ++i) memcpy(avr->flash + chunks[i].baseaddr, chunks[i].data, chunks[i].size);
  avr->reset_pc = avr->pc = kBootStart;
  avr->codeend = avr->flashend;
  return true;
}

}  // namespace

extern "C" {

// nullptr when a file cannot be used; `bootloader` may be empty
AvrBoard* avr_board_new(const char* elf, const char* bootloader) {
  avr_global_logger_set(only_errors);
  elf_firmware_t firmware;
  memset(&firmware, 0, sizeof firmware);
  if (elf_read_firmware(elf, &firmware) != 0) return nullptr;
  avr_t* avr = avr_make_mcu_by_name("atmega2560");
  if (!avr) return nullptr;
  avr_init(avr);
  firmware.frequency = kCyclesPer_us * 1000000;
  firmware.vcc = firmware.avcc = firmware.aref = 5000;
  snprintf(firmware.mmcu, sizeof firmware.mmcu, "atmega2560");
  avr_load_firmware(avr, &firmware);
  if (*bootloader && !load_bootloader(avr, bootloader)) return nullptr;
  AvrBoard* b = new AvrBoard();
  b->avr = avr;
  b->line_free = true;
  b->core_reset = avr->reset;
  boards()[avr] = b;
  avr->reset = on_reset;
  avr->sleep = slept;  // simavr's own would wait for the wall clock
  imu_power_on(b);
  connect(b);
  return b;
}

void avr_board_free(AvrBoard* b) {
  boards().erase(b->avr);
  avr_terminate(b->avr);
  delete b;
}

AvrOutputs* avr_board_outputs(AvrBoard* b) { return &b->out; }

// Begins anew, the clock at 0; `flags` as in MCUSR: power on 1, external 2, brown-out 4, watchdog 8
void avr_board_reset(AvrBoard* b, int flags) {
  if (flags & 1) memset(b->avr->data + kRamStart, kPaint, b->avr->ramend + 1 - kRamStart);
  const uint32_t resets = b->out.resets;
  avr_reset(b->avr);
  b->out.resets = resets;
  b->avr->data[kMcusr] = static_cast<uint8_t>(flags);
  b->edges = decltype(b->edges)();
  b->to_avr.clear();
  for (int i = 0; i < config::kSonarCount; ++i) b->levels['B' - 'A'] &= static_cast<uint8_t>(~(1 << config::kSonarPulse_B[i]));
  b->power_on = b->target = b->avr->cycle;
  if (flags & 1) imu_power_on(b);
  restore(b);
  look(b);
}

// Runs to `until_us` since the last reset, these encoder edges spread over the way
void avr_board_run(AvrBoard* b, uint64_t until_us, int left, int right) {
  static const uint8_t kA[4] = {0, 1, 1, 0}, kB[4] = {0, 0, 1, 1};
  const uint64_t from = b->target;
  const uint64_t to = b->power_on + until_us * kCyclesPer_us;
  if (to <= from) return;
  b->target = to;
  const int counts[2] = {left, right};
  for (int wheel = 0; wheel < 2; ++wheel) {
    const int count = counts[wheel] < 0 ? -counts[wheel] : counts[wheel];
    for (int k = 0; k < count; ++k) {
      const uint8_t old = b->phase[wheel];
      const uint8_t now = static_cast<uint8_t>((old + (counts[wheel] < 0 ? 3 : 1)) & 3);
      const uint64_t at = from + (to - from) * static_cast<uint64_t>(2 * k + 1) / static_cast<uint64_t>(2 * count);
      if (kA[old] != kA[now]) plan(b, 'E', wheel ? config::kEncoderRightA_E : config::kEncoderLeftA_E, kA[now], at);
      if (kB[old] != kB[now]) plan(b, 'D', wheel ? config::kEncoderRightB_D : config::kEncoderLeftB_D, kB[now], at);
      b->phase[wheel] = now;
    }
  }
  pump(b);
  arm(b);
  while (b->avr->cycle < b->target) {
    const int state = avr_run(b->avr);
    if (b->restore) restore(b);
    if (state == cpu_Done || state == cpu_Crashed) break;
  }
  look(b);
}

void avr_board_imu(AvrBoard* b, int ax, int ay, int az, int gx, int gy, int gz) {
  const int values[7] = {ax, ay, az, 0, gx, gy, gz};
  if (!b->imu_answers) imu_power_on(b);
  b->imu_answers = true;
  for (int i = 0; i < 7; ++i) {
    b->registers[0x3B + 2 * i] = static_cast<uint8_t>(static_cast<unsigned>(values[i]) >> 8);
    b->registers[0x3C + 2 * i] = static_cast<uint8_t>(values[i]);
  }
}

void avr_board_imu_unplug(AvrBoard* b) { b->imu_answers = false; }

// The next transfer never ends: simavr cannot hold the clock line, so the interrupt that would tell of it is taken away
void avr_board_imu_hang(AvrBoard* b) { b->imu_hangs = true; }

// The pulse of a sonar, from now on
void avr_board_echo(AvrBoard* b, int sonar, int width_us) {
  if (!width_us) return;
  const int pin = config::kSonarPulse_B[sonar];
  plan(b, 'B', pin, 1, b->target + 1);
  plan(b, 'B', pin, 0, b->target + 1 + static_cast<uint64_t>(width_us) * kCyclesPer_us);
}

void avr_board_inputs(AvrBoard* b, int bumper, int cliff_left, int cliff_right, int stop_button, int battery_mv) {
  drive(b, 'A', config::kBumper_A, bumper);
  drive(b, 'A', config::kCliffLeft_A, cliff_left);
  drive(b, 'A', config::kCliffRight_A, cliff_right);
  drive(b, 'A', config::kStopButton_A, stop_button);
  b->battery_mv = static_cast<uint32_t>(battery_mv);
  set_battery(b);
}

void avr_board_serial_write(AvrBoard* b, const char* data, int length) {
  for (int i = 0; i < length; ++i) b->to_avr.push_back(static_cast<uint8_t>(data[i]));
}

// Bytes of the memory that neither variable nor stack has ever touched since power-on
int avr_board_untouched(const AvrBoard* b) {
  int longest = 0, run = 0;
  for (uint32_t at = kRamStart; at <= b->avr->ramend; ++at) {
    run = b->avr->data[at] == kPaint ? run + 1 : 0;
    if (run > longest) longest = run;
  }
  return longest;
}

}  // extern "C"
