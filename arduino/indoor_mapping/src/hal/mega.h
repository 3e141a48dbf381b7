// Between the drivers of the ATmega2560: what each offers to the board and to the others' interrupts.
#pragma once
#if !defined(__AVR_ATmega2560__)
#error "This firmware is made for the Arduino Mega 2560: choose that board."
#endif
#include <stdint.h>

#include "hal.h"

namespace mega {

// mega_clock.cpp. Timer 1 counts microseconds, timer 3 ticks every millisecond
void begin_clock();
uint32_t micros();
// The loop goes round once in a millisecond; interrupts are served meanwhile
void sleep_until_tick();
uint16_t battery_mv();

// mega_motors.cpp. Timer 5
enum Inhibit : uint8_t { kStopByteSeen = 1, kLoopStuck = 2 };
void begin_motors();
void set_motors(int16_t left, int16_t right);
void enable_driver(bool on);
// Off this instant, and off until the reason is lifted; for interrupts
void inhibit(uint8_t reason);
void lift_inhibit(uint8_t reason);

// mega_encoders.cpp. External interrupts 2 to 5
void begin_encoders();
void read_encoders(int32_t* left, int32_t* right);

// mega_sonars.cpp. Pin-change interrupt 0
void begin_sonars();
void trigger_sonars(uint8_t mask);
void end_triggers();  // from the millisecond tick
bool take_pulse(uint8_t sonar, uint16_t* width_us);

// mega_uart.cpp. USART 0
void begin_uart();
int16_t uart_read();
bool uart_write(const char* data, uint8_t length);

// mpu6050.cpp. Two-wire interface
void begin_imu();
void tick_imu();  // from the millisecond tick
bool take_imu(hal::Imu* reading);

// mega_restart.cpp
uint8_t reset_cause();
uint16_t begin_session();
bool stop_kept();
void keep_stop(bool kept);
// From the millisecond tick: the loop has not come round for `age_ms`
void watch_loop();
// From the loop, on every pass
void loop_alive();
void begin_watchdog();

}  // namespace mega
