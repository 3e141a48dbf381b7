"""Commands of an operator without a screen: one demand, sent until the robot confirms it. For verbs and benchmarks."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable

from common.bus import Bus
from common.messages.topics import PERMIT, STOP
from offboard.operate import operations, software_stop
from offboard.operate.operations import Answer, Order
from offboard.operate.order_sender import OrderSender
from offboard.operate.software_stop import Demand, StopControl
from offboard.operate.stop_press import REPEAT_S, new_stop_id

CONFIRM_TIMEOUT_S = 5.0
_POLL_S = 0.01


def wait_until(condition: Callable[[], bool], timeout_s: float) -> bool:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(_POLL_S)
    return True


def sent_until_confirmed(bus: Bus, control: StopControl) -> StopControl:
    """Sends what is demanded until the robot confirms or CONFIRM_TIMEOUT_S are over; returns what is left."""
    next_s = 0.0

    def over() -> bool:
        nonlocal control, next_s
        now_s = time.monotonic()
        control = software_stop.updated(control, software_stop.robot_report(bus, now_s), now_s)
        request = software_stop.request(control, now_s)
        if request is not None and now_s >= next_s:
            next_s = now_s + REPEAT_S
            bus.publish(STOP, request)
        return control.demand is Demand.NONE

    wait_until(over, CONFIRM_TIMEOUT_S)
    return control


def press_stop(bus: Bus) -> StopControl:
    """One press, sent until it is confirmed: what is left."""
    return hold_stop(bus, time.monotonic(), new_stop_id(secrets.randbits))


def hold_stop(bus: Bus, since_s: float, stop_id: int) -> StopControl:
    """As `press_stop`, of a press from before."""
    return sent_until_confirmed(bus, software_stop.pressed(StopControl(), since_s, stop_id))


def request_release(bus: Bus) -> StopControl:
    """The release of the stop that the robot reports now, sent until it is confirmed; what is left."""
    now_s = time.monotonic()
    report = software_stop.robot_report(bus, now_s)
    return sent_until_confirmed(bus, software_stop.release_requested(StopControl(), report, now_s))


def operate(bus: Bus, order: Order) -> Answer:
    """One command of the operator, sent until it is taken."""
    orders = OrderSender()
    orders.give(operations.new_operation(order, bus.latest(PERMIT), time.monotonic(), secrets.randbits))
    while (answer := orders.step(bus, time.monotonic())) is Answer.WAITING:
        time.sleep(_POLL_S)
    assert answer is not None
    return answer
