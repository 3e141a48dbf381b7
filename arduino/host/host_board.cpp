// The firmware core on a PC: hardware made of plain variables, driven through a C interface by one call per step.
#include <stdint.h>
#include <string.h>

#include "host_board.h"

#include "../indoor_mapping/src/core/robot.h"
#include "../indoor_mapping/src/hal/hal.h"

namespace {

const uint32_t kSpin_us = 1000;
const uint32_t kRxSize = 4096;

class HostHal : public hal::Hal {
 public:
  HostHal(uint8_t cause, uint16_t session, bool stopped) : stopped(stopped), cause_(cause), session_(session) {}

  uint32_t micros() override { return static_cast<uint32_t>(now_us); }
  void encoders(int32_t* left, int32_t* right) override {
    *left = ticks_left;
    *right = ticks_right;
  }
  bool imu(hal::Imu* reading) override {
    *reading = imu_reading;
    return imu_answers;
  }
  void fire(uint8_t mask) override { out.fired |= mask; }
  bool echo(uint8_t sonar, uint16_t* width_us) override {
    if (!echo_us[sonar] || now_us < echo_end_us[sonar]) return false;
    *width_us = echo_us[sonar];
    echo_us[sonar] = 0;
    return true;
  }
  hal::Switches switches() override { return inputs; }
  uint16_t battery_mv() override { return battery; }
  void motors(int16_t left, int16_t right) override {
    out.pwm_left = left;
    out.pwm_right = right;
  }
  void driver_enable(bool on) override { out.enabled = on; }
  int16_t serial_read() override {
    if (rx_taken == rx_length) {
      rx_taken = rx_length = 0;
      return -1;
    }
    return static_cast<uint8_t>(rx[rx_taken++]);
  }
  bool serial_write(const char* data, uint8_t length) override {
    if (out.tx_length + length > kTxSize) return false;
    memcpy(out.tx + out.tx_length, data, length);
    out.tx_length += length;
    return true;
  }
  uint16_t free_ram() override { return 6000; }  // about what the Mega has left
  uint8_t reset_cause() override { return cause_; }
  uint16_t session() override { return session_; }
  bool stop_kept() override { return stopped; }
  void keep_stop(bool kept) override { stopped = kept; }

  Outputs out = Outputs();
  uint64_t now_us = 0;
  int32_t ticks_left = 0, ticks_right = 0;
  hal::Imu imu_reading = hal::Imu();
  bool imu_answers = false;
  uint16_t echo_us[5] = {0, 0, 0, 0, 0};
  uint64_t echo_end_us[5] = {0, 0, 0, 0, 0};
  hal::Switches inputs = hal::Switches();
  uint16_t battery = 12000;
  bool stopped;  // in its EEPROM
  char rx[kRxSize];
  uint32_t rx_length = 0, rx_taken = 0;

 private:
  uint8_t cause_;
  uint16_t session_;
};

}  // namespace

struct Board {
  Board(uint8_t cause, uint16_t session, bool stopped) : hardware(cause, session, stopped), robot(hardware) {}
  HostHal hardware;
  core::Robot robot;
};

extern "C" {

Board* fw_new(int cause, int session, int stopped) {
  return new Board(static_cast<uint8_t>(cause), static_cast<uint16_t>(session), stopped != 0);
}

int fw_stop_kept(Board* board) { return board->hardware.stopped; }

void fw_free(Board* board) { delete board; }

Outputs* fw_outputs(Board* board) { return &board->hardware.out; }

void fw_run(Board* board, uint64_t until_us, int32_t left, int32_t right) {
  HostHal& hardware = board->hardware;
  // Modulo 2^32, as the counters of the Mega are
  hardware.ticks_left = static_cast<int32_t>(static_cast<uint32_t>(hardware.ticks_left) + static_cast<uint32_t>(left));
  hardware.ticks_right = static_cast<int32_t>(static_cast<uint32_t>(hardware.ticks_right) + static_cast<uint32_t>(right));
  while (hardware.now_us < until_us) {
    const uint64_t left_us = until_us - hardware.now_us;
    hardware.now_us += left_us < kSpin_us ? left_us : kSpin_us;
    board->robot.spin();
  }
}

void fw_imu(Board* board, int ax, int ay, int az, int gx, int gy, int gz) {
  hal::Imu& reading = board->hardware.imu_reading;
  reading.ax = static_cast<int16_t>(ax);
  reading.ay = static_cast<int16_t>(ay);
  reading.az = static_cast<int16_t>(az);
  reading.gx = static_cast<int16_t>(gx);
  reading.gy = static_cast<int16_t>(gy);
  reading.gz = static_cast<int16_t>(gz);
  board->hardware.imu_answers = true;
}

void fw_imu_unplug(Board* board) { board->hardware.imu_answers = false; }

void fw_echo(Board* board, int sonar, int width_us) {
  board->hardware.echo_end_us[sonar] = board->hardware.now_us + static_cast<uint64_t>(width_us);
  board->hardware.echo_us[sonar] = static_cast<uint16_t>(width_us);
}

void fw_inputs(Board* board, int bumper, int cliff_left, int cliff_right, int stop_button, int battery_mv) {
  board->hardware.inputs.bumper = bumper != 0;
  board->hardware.inputs.cliff_left = cliff_left != 0;
  board->hardware.inputs.cliff_right = cliff_right != 0;
  board->hardware.inputs.stop_button = stop_button != 0;
  board->hardware.battery = static_cast<uint16_t>(battery_mv);
}

int fw_serial_write(Board* board, const char* data, int length) {
  HostHal& hardware = board->hardware;
  const int room = static_cast<int>(kRxSize - hardware.rx_length);
  const int taken = length < room ? length : room;
  memcpy(hardware.rx + hardware.rx_length, data, static_cast<size_t>(taken));
  hardware.rx_length += static_cast<uint32_t>(taken);
  return taken;
}

int fw_next_state(int state, int conditions) {
  return core::next_state(static_cast<core::CarState>(state), static_cast<uint8_t>(conditions));
}

}  // extern "C"
