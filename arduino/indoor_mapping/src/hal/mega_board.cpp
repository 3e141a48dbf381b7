// The Arduino Mega behind hal.h: puts its drivers together and turns the core's wheel.
#include <avr/interrupt.h>
#include <avr/io.h>

#include "../config.h"
#include "../core/robot.h"
#include "mega.h"

extern "C" char _end;  // of the variables

namespace {

const uint8_t kSwitchPins =
    _BV(config::kBumper_A) | _BV(config::kCliffLeft_A) | _BV(config::kCliffRight_A) | _BV(config::kStopButton_A);

class MegaBoard : public hal::Hal {
 public:
  uint32_t micros() override { return mega::micros(); }
  void encoders(int32_t* left, int32_t* right) override { mega::read_encoders(left, right); }
  bool imu(hal::Imu* reading) override { return mega::take_imu(reading); }
  void fire(uint8_t mask) override { mega::trigger_sonars(mask); }
  bool echo(uint8_t sonar, uint16_t* width_us) override { return mega::take_pulse(sonar, width_us); }
  hal::Switches switches() override {
    // Closed to ground in peace; open, or broken off, is danger
    const uint8_t open = PINA;
    hal::Switches s;
    s.bumper = config::kBumperFitted && (open & _BV(config::kBumper_A));
    s.cliff_left = config::kCliffFitted && (open & _BV(config::kCliffLeft_A));
    s.cliff_right = config::kCliffFitted && (open & _BV(config::kCliffRight_A));
    s.stop_button = config::kStopButtonFitted && (open & _BV(config::kStopButton_A));
    return s;
  }
  uint16_t battery_mv() override { return mega::battery_mv(); }
  void motors(int16_t left, int16_t right) override { mega::set_motors(left, right); }
  void driver_enable(bool on) override { mega::enable_driver(on); }
  int16_t serial_read() override { return mega::uart_read(); }
  bool serial_write(const char* data, uint8_t length) override { return mega::uart_write(data, length); }
  uint16_t free_ram() override { return static_cast<uint16_t>(SP - reinterpret_cast<uint16_t>(&_end)); }
  uint8_t reset_cause() override { return mega::reset_cause(); }
  uint16_t session() override { return session_; }
  bool stop_kept() override { return mega::stop_kept(); }
  void keep_stop(bool kept) override { mega::keep_stop(kept); }
  void begin_session() { session_ = mega::begin_session(); }

 private:
  uint16_t session_ = 0;
};

MegaBoard g_board;

core::Robot& robot() {
  static core::Robot only(g_board);
  return only;
}

}  // namespace

namespace hal {

void begin() {
  mega::begin_motors();
  PORTA |= kSwitchPins;
  g_board.begin_session();
  mega::begin_clock();
  mega::begin_encoders();
  mega::begin_sonars();
  mega::begin_imu();
  mega::begin_uart();
  sei();
  robot();
  mega::begin_watchdog();
}

void spin() {
  mega::loop_alive();
  robot().spin();
#ifdef PLANT_ENDLESS_LOOP
  // Test build only: hangs once it drives
  if (PORTA & _BV(config::kEnable_A) && TCCR5A & _BV(COM5B1)) {
#if PLANT_ENDLESS_LOOP == 2
    cli();
#endif
    for (;;) {
    }
  }
#endif
  mega::sleep_until_tick();
}

}  // namespace hal
