#include "robot.h"

#include "errors.h"
#include "fixed_point.h"

namespace core {
namespace {

const uint32_t kTick_us = config::kTick_ms * 1000ul;

int32_t limited(int32_t value, int32_t maximum) { return value > maximum ? maximum : value; }

}  // namespace

Robot::Robot(hal::Hal& hardware)
    : hardware_(hardware), state_(CAR_STATE_BOOT), told_(), told_stop_(), now_us_(hardware.micros()), now_ms_(0), rest_us_(0),
      next_tick_us_(now_us_), heartbeat_ms_(0), hello_ms_(0), stop_epoch_(0), sequence_(0), button_count_(0),
      ticks_(0), stop_sources_(0),
      heartbeat_seen_(false), armed_(false), enabled_(false), lost_(false), said_hello_(false), started_once_(false),
      switches_() {
  hardware_.motors(0, 0);
  hardware_.driver_enable(false);
  if (hardware_.stop_kept()) stop_sources_ = STOP_SOURCE_FLAG_BUTTON;
}

void Robot::advance_time() {
  const uint32_t now_us = hardware_.micros();
  uint32_t elapsed_us = now_us - now_us_ + rest_us_;
  now_us_ = now_us;
  // A loop, because the AVR divides slowly and mostly one millisecond has passed
  for (; elapsed_us >= 1000u; elapsed_us -= 1000u) ++now_ms_;
  rest_us_ = static_cast<uint16_t>(elapsed_us);
}

void Robot::spin() {
  advance_time();
  receive();
  sonars_.update(hardware_, now_us_);
  if (static_cast<int32_t>(now_us_ - next_tick_us_) < 0) return;
  next_tick_us_ += kTick_us;
  // After a long pause the missed ticks are not made up for
  if (static_cast<int32_t>(now_us_ - next_tick_us_) >= 0) next_tick_us_ = now_us_ + kTick_us;
  tick();
}

void Robot::receive() {
  for (int16_t byte = hardware_.serial_read(); byte >= 0; byte = hardware_.serial_read()) {
    if (byte == kStopByte) {
      stop(STOP_SOURCE_FLAG_LINE);
      continue;
    }
    Line line;
    if (decoder_.feed(static_cast<char>(byte), &line)) handle(line);
  }
}

void Robot::handle(const Line& line) {
  if (!same(line.receiver, "CAR")) return;
  Start start_message;
  Hb heartbeat;
  Drv drive_message;
  Stop stop_message;
  Rel release_message;
  if (same(line.type, kHbType) && read(line.fields, &heartbeat)) {
    if (!in_time(heartbeat.epoch)) return;
    heartbeat_ms_ = now_ms_;
    heartbeat_seen_ = true;
  } else if (same(line.type, kDrvType) && read(line.fields, &drive_message)) {
    acknowledge(kDrvNumber, drive_message.command_id, drive(drive_message));
  } else if (same(line.type, kStopType) && read(line.fields, &stop_message)) {
    stop(STOP_SOURCE_FLAG_LINE);
    in_time(stop_message.epoch);
    acknowledge(kStopNumber, 0, true);
  } else if (same(line.type, kRelType) && read(line.fields, &release_message)) {
    acknowledge(kRelNumber, 0, release(release_message));
  } else if (same(line.type, kStartType) && read(line.fields, &start_message)) {
    acknowledge(kStartNumber, 0, start(start_message));
  }
}

void Robot::acknowledge(uint8_t number, int32_t id, bool done) {
  Ack ack;
  ack.of = number;
  ack.id = id;
  ack.result = done ? ACK_RESULT_OK : ACK_RESULT_REFUSED;
  send(ack);
}

void Robot::stop(uint8_t source) {
  stop_sources_ |= source;
  armed_ = false;
  carrier_.cut();
  enabled_ = false;
  hardware_.driver_enable(false);
  hardware_.motors(0, 0);
  if (source == STOP_SOURCE_FLAG_BUTTON) hardware_.keep_stop(true);
}

bool Robot::in_time(int32_t epoch) {
  if (epoch < stop_epoch_) return false;
  stop_epoch_ = epoch;
  return true;
}

bool Robot::release(const Rel& message) {
  if (!in_time(message.epoch) || hardware_.switches().stop_button) return false;
  if (stop_sources_ & STOP_SOURCE_FLAG_BUTTON) hardware_.keep_stop(false);
  stop_sources_ = 0;
  return true;
}

bool Robot::start(const Start& message) {
  if (message.hash != kProtocolHash || !in_time(message.epoch) || stop_sources_) return false;
  armed_ = true;
  lost_ = false;
  started_once_ = true;
  return true;
}

bool Robot::drive(const Drv& message) {
  const bool ready = state_ == CAR_STATE_READY || state_ == CAR_STATE_MOVING || state_ == CAR_STATE_BACKING_OFF;
  if (!ready || !armed_ || stop_sources_ || heartbeat_age_ms() > config::kHeartbeatTimeout_ms) return false;
  return carrier_.drive(message);
}

uint32_t Robot::heartbeat_age_ms() const { return heartbeat_seen_ ? now_ms_ - heartbeat_ms_ : 0xFFFFFFFFu; }

uint8_t Robot::conditions() const {
  uint8_t c = 0;
  if (odometry_.gyro().calibrated()) c |= kCalibrated;
  if (armed_) c |= kArmed;
  if (heartbeat_age_ms() <= config::kHeartbeatTimeout_ms) c |= kHeartbeat;
  if (stop_sources_) c |= kStopLatched;
  if (odometry_.imu_silent()) c |= kFaulty;
  if (carrier_.moving()) c |= kMoving;
  if (carrier_.backing_off()) c |= kContact;
  return c;
}

void Robot::tick() {
  const bool was_pressed = switches_.stop_button;
  switches_ = hardware_.switches();
  if (switches_.stop_button && !was_pressed) ++button_count_;
  if (switches_.stop_button && !(stop_sources_ & STOP_SOURCE_FLAG_BUTTON)) stop(STOP_SOURCE_FLAG_BUTTON);
  odometry_.update(hardware_, now_us_, carrier_.pwm_left() == 0 && carrier_.pwm_right() == 0);
  if (sonars_.take_news(kLeft)) odometry_.hear_wall(false, sonars_.range_mm(kLeft));
  if (sonars_.take_news(kRight)) odometry_.hear_wall(true, sonars_.range_mm(kRight));

  const uint32_t age_ms = heartbeat_age_ms();
  if (age_ms > config::kDisarm_ms) {
    armed_ = false;
    heartbeat_seen_ = false;  // its age must not wrap round to young again
  }
  if (armed_) {
    const bool lost = age_ms > config::kHeartbeatTimeout_ms;
    if (lost && !lost_ && carrier_.moving()) carrier_.abandon(true);
    lost_ = lost;
  }
  Obstacles obstacles;
  obstacles.contact = sonars_.contact(now_us_);
  obstacles.clear_in_front = sonars_.clear_in_front(now_us_);
  obstacles.bumper = switches_.bumper;
  obstacles.cliff = switches_.cliff_left || switches_.cliff_right;
  carrier_.update(odometry_, obstacles);
  state_ = next_state(state_, conditions());
  set_motors(age_ms);
  report();
}

void Robot::set_motors(uint32_t age_ms) {
  const bool working = state_ == CAR_STATE_READY || state_ == CAR_STATE_MOVING || state_ == CAR_STATE_BACKING_OFF;
  const bool fresh = age_ms <= config::kHeartbeatTimeout_ms;
  const bool coming_to_rest = carrier_.moving() && age_ms <= config::kDriverOff_ms;
  enabled_ = armed_ && !stop_sources_ && working && (fresh || coming_to_rest);
  if (!enabled_ && carrier_.moving()) carrier_.cut();
  hardware_.driver_enable(enabled_);
  hardware_.motors(enabled_ ? carrier_.pwm_left() : 0, enabled_ ? carrier_.pwm_right() : 0);
}

template <typename Message>
void Robot::send(const Message& message) {
  write(encoder_, message, now_ms_);
  const uint8_t length = encoder_.finish();
  if (length) hardware_.serial_write(encoder_.data(), length);
}

void Robot::report() {
  // The period's reports follow one another within two ticks, so that the other end wakes once for all of them: first
  // what nobody acts on at once, at the end what was measured. That a drive command has come, or was completed, can wait
  const bool states_due = ticks_ == 0, sensors_due = ticks_ == 1;
  if (states_due) report_sim();
  report_stop(states_due);
  const CarSta status = car_status();
  const bool changed = status.state != told_.state || status.error != told_.error ||
                       status.aborted_id != told_.aborted_id || status.enabled != told_.enabled ||
                       status.stop_latched != told_.stop_latched;
  if (changed || sensors_due) report_car(status);
  if (sensors_due) {
    ++sequence_;
    report_odometry();
    report_ranges();
  }
  const bool due = !said_hello_ || now_ms_ - hello_ms_ >= config::kHello_ms;
  if (!armed_ && due) say_hello();
  ticks_ = static_cast<uint8_t>((ticks_ + 1) % config::kReportTicks);
}

void Robot::report_odometry() {
  Odo odo;
  odo.seq = sequence_;
  odo.ticks_left = odometry_.ticks_left();
  odo.ticks_right = odometry_.ticks_right();
  odo.yaw_cdeg = odometry_.yaw_cdeg();
  odo.by_walls_cdeg = odometry_.yaw_by_walls_cdeg();
  odo.rate_cdps = odometry_.gyro().rate_cdps();
  odo.x_mm = odometry_.x_mm();
  odo.y_mm = odometry_.y_mm();
  odo.speed_mm_s = clamp(odometry_.speed_mm_s(), 2000);
  odo.flags = 0;
  if (odometry_.standing()) odo.flags |= ODO_FLAG_STANDING;
  if (switches_.bumper) odo.flags |= ODO_FLAG_BUMPER;
  if (switches_.cliff_left) odo.flags |= ODO_FLAG_CLIFF_LEFT;
  if (switches_.cliff_right) odo.flags |= ODO_FLAG_CLIFF_RIGHT;
  if (odometry_.gyro().calibrated()) odo.flags |= ODO_FLAG_CALIBRATED;
  send(odo);
}

void Robot::report_ranges() {
  Rng ranges;
  ranges.seq = sequence_;
  for (uint8_t i = 0; i < config::kSonarCount; ++i) {
    ranges.range_mm[i] = limited(sonars_.range_mm(i), 6500);
    ranges.age_ms[i] = sonars_.age_ms(i, now_us_);
  }
  send(ranges);
  const Distances distances = sonars_.distances(now_us_);
  Dst report;
  report.left_mm = limited(distances.left_mm, 6600);
  report.right_mm = limited(distances.right_mm, 6600);
  report.front_mm = limited(distances.front_mm, 6600);
  send(report);
}

void Robot::report_sim() {
  SimSta status;
  status.state = odometry_.gyro().calibrated() ? SIM_STATE_RUNNING : SIM_STATE_BOOT;
  status.error = kOk;
  const uint16_t battery_mv = hardware_.battery_mv();
  // 0 mV: not wired
  if (battery_mv && battery_mv < config::kBatteryLow_mv) status.error = kBatteryLow;
  if (sonars_.silent()) status.error = kSonarSilent;
  if (odometry_.imu_silent()) {
    status.error = kImuSilent;
    status.state = SIM_STATE_FAULT;
  }
  status.free_ram = hardware_.free_ram();
  status.bad_lines = decoder_.bad();
  status.pitch_cdeg = odometry_.tilt().pitch_cdeg();
  status.roll_cdeg = odometry_.tilt().roll_cdeg();
  send(status);
}

CarSta Robot::car_status() const {
  CarSta status;
  status.state = state_;
  status.error = carrier_.error();
  if (lost_) status.error = kHeartbeatLost;
  if (stop_sources_) status.error = kStopped;
  if (!started_once_ && hardware_.reset_cause() == RESET_CAUSE_WATCHDOG) status.error = kLoopLockup;
  status.boot = carrier_.boot();
  status.command_id = carrier_.command_id();
  status.completed_id = carrier_.completed_id();
  status.aborted_id = carrier_.aborted_id();
  status.speed_mm_s = clamp(odometry_.speed_mm_s(), 2000);
  status.pwm_left = enabled_ ? carrier_.pwm_left() : 0;
  status.pwm_right = enabled_ ? carrier_.pwm_right() : 0;
  status.enabled = enabled_;
  status.stop_latched = stop_sources_;
  status.battery_mv = hardware_.battery_mv();
  status.backing_off = carrier_.backing_off();
  return status;
}

void Robot::report_car(const CarSta& status) {
  told_ = status;
  send(status);
}

void Robot::report_stop(bool due) {
  Stp stop;
  stop.latched = stop_sources_;
  if (switches_.stop_button) stop.latched |= STOP_SOURCE_FLAG_PRESSED;
  stop.epoch = stop_epoch_;
  stop.button_count = button_count_;
  const bool changed = stop.latched != told_stop_.latched || stop.epoch != told_stop_.epoch ||
                       stop.button_count != told_stop_.button_count;
  if (!changed && !due) return;
  told_stop_ = stop;
  send(stop);
}

void Robot::say_hello() {
  said_hello_ = true;
  hello_ms_ = now_ms_;
  Hello hello;
  hello.version = kProtocolVersion;
  hello.hash = kProtocolHash;
  hello.reset_cause = hardware_.reset_cause();
  hello.session = hardware_.session();
  send(hello);
}

}  // namespace core
