// The whole firmware: serial line, sonars, odometry, Carrier and safety around one 10 ms tick.
#pragma once
#include <stdint.h>

#include "../hal/hal.h"
#include "carrier.h"
#include "line_codec.h"
#include "odometry.h"
#include "protocol.h"
#include "safety.h"
#include "sonar.h"

namespace core {

class Robot {
 public:
  explicit Robot(hal::Hal& hardware);
  // From loop(), as often as it can
  void spin();

 private:
  void advance_time();
  void receive();
  void handle(const Line& line);
  void acknowledge(uint8_t number, int32_t id, bool done);
  void stop(uint8_t source);
  bool release();
  bool start(const Start& message);
  bool drive(const Drv& message);
  void tick();
  uint8_t conditions() const;
  void set_motors(uint32_t heartbeat_age_ms);
  void report();
  void report_odometry();
  void report_ranges();
  void report_sim();
  CarSta car_status() const;
  void report_car(const CarSta& status);
  void say_hello();
  template <typename Message>
  void send(const Message& message);
  uint32_t heartbeat_age_ms() const;

  hal::Hal& hardware_;
  LineDecoder decoder_;
  LineEncoder encoder_;
  Sonars sonars_;
  Odometry odometry_;
  Carrier carrier_;
  CarState state_;
  CarSta told_;             // what the last report of the Carrier said
  uint32_t now_us_, now_ms_;
  uint16_t rest_us_;
  uint32_t next_tick_us_;
  uint32_t heartbeat_ms_;
  uint32_t hello_ms_;
  uint16_t sequence_;
  uint8_t ticks_;
  uint8_t stop_sources_;
  bool heartbeat_seen_, armed_, enabled_, lost_, said_hello_, started_once_;
  hal::Switches switches_;
};

}  // namespace core
