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
  // Whether a message belongs to the newest stop epoch that this board knows, or to a newer one, which it then stores
  bool in_time(int32_t epoch);
  bool release(const Rel& message);
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
  void report_stop(bool due);
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
  CarSta told_;             // the last report of the Carrier
  Stp told_stop_;           // and that of the stop
  uint32_t now_us_, now_ms_;
  uint16_t rest_us_;
  uint32_t next_tick_us_;
  uint32_t heartbeat_ms_;
  uint32_t hello_ms_;
  int32_t stop_epoch_;      // 0: none known since the restart
  uint16_t sequence_;
  uint16_t button_count_;   // presses
  uint8_t ticks_;
  uint8_t stop_sources_;
  bool heartbeat_seen_, armed_, enabled_, lost_, said_hello_, started_once_;
  hal::Switches switches_;
};

}  // namespace core
