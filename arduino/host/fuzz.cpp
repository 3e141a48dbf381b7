// Whatever arrives on the line, the core neither crashes nor starts a motor. Built with the sanitizers on, in two ways:
// by clang with -fsanitize=fuzzer (libFuzzer brings its own main), or with RANDOM_BYTES for a run of so many bytes.
// No input holds a START: that would need heartbeats, the hash and two right checksums, and is no accident.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "host_board.h"

namespace {

const uint64_t kStep_us = 5000;
const int kBytesPerStep = 57;  // what the line carries in that time

struct Bench {
  Bench() : board(fw_new(0, 1, 0)), now_us(0) {
    while (now_us < 3000000) step();  // until the gyro is calibrated
  }
  ~Bench() { fw_free(board); }
  void step() {
    fw_imu(board, 0, 0, 16384, 0, 0, 40);
    now_us += kStep_us;
    fw_run(board, now_us, 0, 0);
    Outputs* out = fw_outputs(board);
    if (out->enabled || out->pwm_left || out->pwm_right) abort();
    out->tx_length = 0;
  }
  void feed(const uint8_t* data, size_t size) {
    for (size_t at = 0; at < size; at += kBytesPerStep) {
      const size_t left = size - at;
      fw_serial_write(board, reinterpret_cast<const char*>(data + at), static_cast<int>(left < kBytesPerStep ? left : kBytesPerStep));
      step();
    }
  }
  Board* board;
  uint64_t now_us;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  Bench bench;
  bench.feed(data, size);
  return 0;
}

#ifdef RANDOM_BYTES
int main() {
  // Half of it any byte, half of it what lines are made of
  static const char kLike[] = "CM_CAR_PLN_START,HB,DRV,STOP,REL,-0123456789*ABCDEF\n\n";
  Bench bench;
  uint32_t state = 1;
  for (long sent = 0; sent < RANDOM_BYTES; sent += kBytesPerStep) {
    uint8_t chunk[kBytesPerStep];
    for (uint8_t& byte : chunk) {
      state = state * 1664525u + 1013904223u;
      const uint32_t r = state >> 8;
      byte = static_cast<uint8_t>(sent / 4096 % 2 ? r : static_cast<uint8_t>(kLike[r % (sizeof kLike - 1)]));
    }
    bench.feed(chunk, sizeof chunk);
  }
  puts("held");
  return 0;
}
#endif
