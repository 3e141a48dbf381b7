// The only door to hardware. The AVR drivers implement it on the Mega, arduino/host on a PC.
// Nothing here blocks. Interrupt service routines live behind it: they count edges, time pulses and fill rings;
// each getter takes its value with interrupts off.
#pragma once
#include <stdint.h>

namespace hal {

struct Imu {
  int16_t ax, ay, az;  // +-2 g
  int16_t gx, gy, gz;  // +-500 deg/s
};

struct Switches {
  bool bumper;
  bool cliff_left, cliff_right;
  bool stop_button;
};

struct Hal {
  virtual uint32_t micros() = 0;
  // Cumulative quadrature edges, forward positive
  virtual void encoders(int32_t* left, int32_t* right) = 0;
  // One fresh reading; false when the chip does not answer
  virtual bool imu(Imu* reading) = 0;
  // Begins a ranging of every sonar whose bit is set
  virtual void fire(uint8_t mask) = 0;
  // True once for each finished pulse of that sonar
  virtual bool echo(uint8_t sonar, uint16_t* width_us) = 0;
  virtual Switches switches() = 0;
  virtual uint16_t battery_mv() = 0;
  // -255..255; the driver's own enable line comes apart, so that it also wins over a stuck PWM
  virtual void motors(int16_t left, int16_t right) = 0;
  virtual void driver_enable(bool on) = 0;
  // Next received byte, or -1
  virtual int16_t serial_read() = 0;
  // All of it into the transmit ring, or (false) nothing of it: half a line helps nobody
  virtual bool serial_write(const char* data, uint8_t length) = 0;
  virtual uint16_t free_ram() = 0;
  virtual uint8_t reset_cause() = 0;
  // Another number after each restart
  virtual uint16_t session() = 0;
  // A stop by the button, which outlives every restart and the loss of power
  virtual bool stop_kept() = 0;
  virtual void keep_stop(bool kept) = 0;

 protected:
  ~Hal() {}
};

// The sketch's setup() and loop(), implemented by the drivers of the board
void begin();
void spin();

}  // namespace hal
