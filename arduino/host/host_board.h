// The C interface of host_board.cpp: offboard/simulator/electronics/board.py calls it, and the fuzzer.
#pragma once
#include <stdint.h>

static const uint32_t kTxSize = 65536;

struct Board;

extern "C" {

// Shared with Python, which reads its fields after each call of fw_run
struct Outputs {
  int32_t pwm_left, pwm_right;
  int32_t enabled;
  uint32_t fired;      // sonars triggered since they were last taken, one bit each
  uint32_t tx_length;  // bytes waiting in tx
  char tx[kTxSize];
};

// `stopped`: what the board before it kept over its restart, `fw_stop_kept`
Board* fw_new(int cause, int session, int stopped);
int fw_stop_kept(Board* board);
void fw_free(Board* board);
Outputs* fw_outputs(Board* board);
// Runs the firmware up to `until_us` with these edges counted at its beginning
void fw_run(Board* board, uint64_t until_us, int32_t left, int32_t right);
void fw_imu(Board* board, int ax, int ay, int az, int gx, int gy, int gz);
void fw_imu_unplug(Board* board);
// The pulse of a sonar, from now on
void fw_echo(Board* board, int sonar, int width_us);
void fw_inputs(Board* board, int bumper, int cliff_left, int cliff_right, int stop_button, int battery_mv);
// Bytes into the receive ring; how many of them fitted
int fw_serial_write(Board* board, const char* data, int length);
// The safety state machine alone
int fw_next_state(int state, int conditions);

}  // extern "C"
