#include "safety.h"

namespace core {
namespace {

const uint8_t kAnyState = 0x7F;

constexpr uint8_t in(CarState state) { return static_cast<uint8_t>(1 << state); }

struct Transition {
  uint8_t from;     // states
  uint8_t all;      // conditions that must hold
  uint8_t none;     // conditions that must not
  CarState to;
};

const uint8_t kWorking = in(CAR_STATE_READY) | in(CAR_STATE_MOVING) | in(CAR_STATE_BACKING_OFF);

// The first row that fits counts: what stops stands above what moves
const Transition kTable[] = {
    {kAnyState, kFaulty, 0, CAR_STATE_FAULT},
    {in(CAR_STATE_FAULT), kCalibrated, kFaulty, CAR_STATE_DISARMED},
    {in(CAR_STATE_FAULT), 0, kFaulty, CAR_STATE_BOOT},
    {in(CAR_STATE_BOOT), 0, kCalibrated, CAR_STATE_BOOT},
    {kAnyState, kStopLatched, 0, CAR_STATE_STOPPED},
    {in(CAR_STATE_BOOT) | in(CAR_STATE_STOPPED), 0, kStopLatched, CAR_STATE_DISARMED},
    {kWorking, 0, kArmed, CAR_STATE_DISARMED},
    {in(CAR_STATE_DISARMED), kArmed | kHeartbeat, 0, CAR_STATE_READY},
    {in(CAR_STATE_MOVING) | in(CAR_STATE_BACKING_OFF), 0, kHeartbeat, CAR_STATE_READY},
    {kWorking, kContact | kHeartbeat, 0, CAR_STATE_BACKING_OFF},
    {kWorking, kMoving | kHeartbeat, kContact, CAR_STATE_MOVING},
    {in(CAR_STATE_MOVING) | in(CAR_STATE_BACKING_OFF), 0, kMoving | kContact, CAR_STATE_READY},
};

}  // namespace

CarState next_state(CarState state, uint8_t conditions) {
  for (uint8_t i = 0; i < sizeof(kTable) / sizeof(kTable[0]); ++i) {
    const Transition& row = kTable[i];
    if ((row.from & in(state)) && (conditions & row.all) == row.all && !(conditions & row.none)) return row.to;
  }
  return state;
}

}  // namespace core
