// Written by generate_protocol.py from protocol.toml; do not edit.
#pragma once
#include <stdint.h>

#include "line_codec.h"

namespace core {

static const uint16_t kProtocolVersion = 2;
static const uint16_t kProtocolHash = 0x10A1;
static const uint8_t kStopByte = 0x18;

enum SimState : uint8_t {
  SIM_STATE_BOOT = 0,
  SIM_STATE_RUNNING = 1,
  SIM_STATE_FAULT = 2,
};

enum CarState : uint8_t {
  CAR_STATE_BOOT = 0,
  CAR_STATE_DISARMED = 1,
  CAR_STATE_READY = 2,
  CAR_STATE_MOVING = 3,
  CAR_STATE_BACKING_OFF = 4,
  CAR_STATE_STOPPED = 5,
  CAR_STATE_FAULT = 6,
};

enum OdoFlag : uint8_t {
  ODO_FLAG_STANDING = 1,
  ODO_FLAG_BUMPER = 2,
  ODO_FLAG_CLIFF_LEFT = 4,
  ODO_FLAG_CLIFF_RIGHT = 8,
  ODO_FLAG_CALIBRATED = 16,
};

enum StopSourceFlag : uint8_t {
  STOP_SOURCE_FLAG_LINE = 1,
  STOP_SOURCE_FLAG_BUTTON = 2,
  STOP_SOURCE_FLAG_PRESSED = 4,
};

enum ResetCause : uint8_t {
  RESET_CAUSE_POWER_ON = 0,
  RESET_CAUSE_EXTERNAL = 1,
  RESET_CAUSE_BROWN_OUT = 2,
  RESET_CAUSE_WATCHDOG = 3,
};

enum AckResult : uint8_t {
  ACK_RESULT_OK = 0,
  ACK_RESULT_REFUSED = 1,
};

// SIM -> CM, at boot, then 1 Hz while not armed
struct Hello {
  int32_t version;
  int32_t hash;  // of this file's messages
  int32_t reset_cause;
  int32_t session;  // another one after each restart
};
inline void write(LineEncoder& line, const Hello& m, uint32_t now_ms) {
  line.begin("SIM", "CM", now_ms, "HELLO");
  line.put_field(m.version);
  line.put_field(m.hash);
  line.put_field(m.reset_cause);
  line.put_field(m.session);
}

// SIM -> MMU, 10 Hz
struct Odo {
  int32_t seq;
  int32_t ticks_left;  // cumulative quadrature edges
  int32_t ticks_right;
  int32_t yaw_cdeg;  // 0.01 deg
  int32_t by_walls_cdeg;  // 0.01 deg, that much of yaw_cdeg is measured by walls, the rest by the gyro
  int32_t rate_cdps;  // 0.01 deg/s
  int32_t x_mm;  // mm
  int32_t y_mm;  // mm
  int32_t speed_mm_s;  // mm/s
  int32_t flags;  // odo_flag
};
inline void write(LineEncoder& line, const Odo& m, uint32_t now_ms) {
  line.begin("SIM", "MMU", now_ms, "ODO");
  line.put_field(m.seq);
  line.put_field(m.ticks_left);
  line.put_field(m.ticks_right);
  line.put_field(m.yaw_cdeg);
  line.put_field(m.by_walls_cdeg);
  line.put_field(m.rate_cdps);
  line.put_field(m.x_mm);
  line.put_field(m.y_mm);
  line.put_field(m.speed_mm_s);
  line.put_field(m.flags);
}

// SIM -> MMU, 10 Hz
struct Rng {
  int32_t seq;
  int32_t range_mm[5];  // mm, from the transducer; 0 = no echo; left, front left, front, front right, right
  int32_t age_ms[5];  // ms, since it was fired
};
inline void write(LineEncoder& line, const Rng& m, uint32_t now_ms) {
  line.begin("SIM", "MMU", now_ms, "RNG");
  line.put_field(m.seq);
  for (uint8_t i = 0; i < 5; ++i) line.put_field(m.range_mm[i]);
  for (uint8_t i = 0; i < 5; ++i) line.put_field(m.age_ms[i]);
}

// SIM -> PLN, 10 Hz
struct Dst {
  int32_t left_mm;  // mm, from the centre of the ring; 0 = no echo
  int32_t right_mm;  // mm
  int32_t front_mm;  // mm
};
inline void write(LineEncoder& line, const Dst& m, uint32_t now_ms) {
  line.begin("SIM", "PLN", now_ms, "DST");
  line.put_field(m.left_mm);
  line.put_field(m.right_mm);
  line.put_field(m.front_mm);
}

// SIM -> CM, 10 Hz
struct SimSta {
  int32_t state;  // sim_state
  int32_t error;  // common/errors.py
  int32_t free_ram;  // bytes
  int32_t bad_lines;  // damaged lines received
  int32_t pitch_cdeg;  // 0.01 deg, nose up positive
  int32_t roll_cdeg;  // 0.01 deg, left side up positive
};
inline void write(LineEncoder& line, const SimSta& m, uint32_t now_ms) {
  line.begin("SIM", "CM", now_ms, "STA");
  line.put_field(m.state);
  line.put_field(m.error);
  line.put_field(m.free_ram);
  line.put_field(m.bad_lines);
  line.put_field(m.pitch_cdeg);
  line.put_field(m.roll_cdeg);
}

// CAR -> CM, 10 Hz and at once on change
struct CarSta {
  int32_t state;  // car_state
  int32_t error;  // common/errors.py
  int32_t boot;  // of the commands that follow
  int32_t command_id;  // in force, 0 = none
  int32_t completed_id;  // the newest one whose heading was reached
  int32_t aborted_id;  // the newest one given up
  int32_t speed_mm_s;  // mm/s
  int32_t pwm_left;
  int32_t pwm_right;
  int32_t enabled;
  int32_t stop_latched;  // stop_source bits
  int32_t battery_mv;  // mV
  int32_t backing_off;
};
inline void write(LineEncoder& line, const CarSta& m, uint32_t now_ms) {
  line.begin("CAR", "CM", now_ms, "STA");
  line.put_field(m.state);
  line.put_field(m.error);
  line.put_field(m.boot);
  line.put_field(m.command_id);
  line.put_field(m.completed_id);
  line.put_field(m.aborted_id);
  line.put_field(m.speed_mm_s);
  line.put_field(m.pwm_left);
  line.put_field(m.pwm_right);
  line.put_field(m.enabled);
  line.put_field(m.stop_latched);
  line.put_field(m.battery_mv);
  line.put_field(m.backing_off);
}

// CAR -> CM, 10 Hz and at once on change
struct Stp {
  int32_t latched;  // stop_source bits
  int32_t epoch;  // of the newest stop that is known, 0 = none since the restart
  int32_t button_count;  // how often the button was pressed since the restart
};
inline void write(LineEncoder& line, const Stp& m, uint32_t now_ms) {
  line.begin("CAR", "CM", now_ms, "STP");
  line.put_field(m.latched);
  line.put_field(m.epoch);
  line.put_field(m.button_count);
}

// CAR -> CM, on START, REL, STOP and DRV
struct Ack {
  int32_t of;  // number of the message type answered
  int32_t id;  // command of a DRV, else 0
  int32_t result;  // ack_result
};
inline void write(LineEncoder& line, const Ack& m, uint32_t now_ms) {
  line.begin("CAR", "CM", now_ms, "ACK");
  line.put_field(m.of);
  line.put_field(m.id);
  line.put_field(m.result);
}

// CM -> CAR, after HELLO, when the robot may move
struct Start {
  int32_t hash;  // another one than the board's is refused
  int32_t epoch;  // an older one than the board's is refused
};
static const uint8_t kStartNumber = 1;
static const char kStartType[] = "START";
inline bool read(const char* fields, Start* m) {
  if (!read_field(&fields, 0, 65535, &m->hash)) return false;
  if (!read_field(&fields, 0, 2147483647, &m->epoch)) return false;
  return *fields == 0;
}

// CM -> CAR, 10 Hz while the robot may move
struct Hb {
  int32_t seq;
  int32_t epoch;  // of the permit; an older one than the board's is no heartbeat
};
static const uint8_t kHbNumber = 2;
static const char kHbType[] = "HB";
inline bool read(const char* fields, Hb* m) {
  if (!read_field(&fields, 0, 65535, &m->seq)) return false;
  if (!read_field(&fields, 0, 2147483647, &m->epoch)) return false;
  return *fields == 0;
}

// PLN -> CAR, on a new command, then 10 Hz until it is in force
struct Drv {
  int32_t boot;  // of the planner, which counts its commands anew
  int32_t command_id;
  int32_t speed;  // REVERSE, STOP, MEDIUM, HIGH
  int32_t yaw_cdeg;  // 0.01 deg
};
static const uint8_t kDrvNumber = 3;
static const char kDrvType[] = "DRV";
inline bool read(const char* fields, Drv* m) {
  if (!read_field(&fields, 0, 65535, &m->boot)) return false;
  if (!read_field(&fields, 1, 2147483647, &m->command_id)) return false;
  if (!read_field(&fields, -1, 2, &m->speed)) return false;
  if (!read_field(&fields, 0, 35999, &m->yaw_cdeg)) return false;
  return *fields == 0;
}

// CM -> CAR, like the stop byte, and until the board knows the epoch
struct Stop {
  int32_t epoch;
};
static const uint8_t kStopNumber = 4;
static const char kStopType[] = "STOP";
inline bool read(const char* fields, Stop* m) {
  if (!read_field(&fields, 0, 2147483647, &m->epoch)) return false;
  return *fields == 0;
}

// CM -> CAR, releases the latched stop; moves nothing
struct Rel {
  int32_t epoch;  // an older one than the board's is refused
};
static const uint8_t kRelNumber = 5;
static const char kRelType[] = "REL";
inline bool read(const char* fields, Rel* m) {
  if (!read_field(&fields, 0, 2147483647, &m->epoch)) return false;
  return *fields == 0;
}

}  // namespace core
