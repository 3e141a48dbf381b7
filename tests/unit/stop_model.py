"""A small world for the stop: comm's owner and the bridge's gate as they are, a board, a disk and people, and messages
that are lost, late, doubled and overtaken, while any of them dies at any moment.

`World` raises `Violation` when the robot may move though a stop acted that was not released and resumed. A stop acts
once the bridge holds it, knows it from a permit, or the disk has it. One that only a bridge knew which dies beside a
living comm is not confirmed, and whoever pressed in a command center still sends it: it acts again when it arrives.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random
from typing import Any

from common.messages.stop import Permit, StopRequest
from onboard.bridge.motion_gate import MotionGate, button_press
from onboard.bridge.protocol import StopSourceFlag, Stp
from onboard.comm import stop_owner
from onboard.comm.stop_owner import BridgeReport, StopOwner
from onboard.comm.stop_record import Stop, StopRecord

TICK_S = 0.1
PERMIT_TICKS = 2  # a permit on its way arrives within as many, or never
BOUND_TICKS = 8  # from the moment that comm or bridge knows a stop to the last heartbeat that the board takes


class Violation(AssertionError):
    pass


@dataclass
class Board:
    """What the firmware does with the lines of the bridge (arduino/indoor_mapping/src/core/robot.cpp)."""

    session: int = 1
    epoch: int = 0
    latched: int = 0
    count: int = 0
    pressed: bool = False
    armed: bool = False

    def report(self) -> Stp:
        return Stp(self.latched | (StopSourceFlag.PRESSED if self.pressed else 0), self.epoch, self.count)

    def press(self, pressed: bool) -> None:
        if pressed and not self.pressed:
            self.count += 1
            self.latched |= StopSourceFlag.BUTTON
            self.armed = False
        self.pressed = pressed

    def take(self, line: tuple[str, int]) -> bool:
        """Whether it was a heartbeat of a board that may move now."""
        kind, epoch = line
        if kind in ("byte", "stop"):
            self.latched |= StopSourceFlag.LINE
            self.armed = False
        if epoch < self.epoch:
            return False
        self.epoch = epoch if kind != "byte" else self.epoch
        if kind == "release" and not self.pressed:
            self.latched = 0
        elif kind == "start" and not self.latched:
            self.armed = True
        return kind == "heartbeat" and self.armed and not self.latched

    def reset(self) -> None:
        """It forgets all but a stop by its button."""
        pressed, kept = self.pressed, self.latched & StopSourceFlag.BUTTON
        self.__init__(session=self.session + 1, latched=kept)  # type: ignore[misc]
        self.press(pressed)


@dataclass
class Ghost:
    """What nobody in the world knows: which stops acted when, in which epoch, and what was released and resumed."""

    acted: dict[int, int] = field(default_factory=dict)  # stop id -> tick
    epoch: dict[int, int] = field(default_factory=dict)  # stop id -> the newest in which it was latched
    released: int = 0
    resumed: int = 0

    def act(self, stop_id: int, tick: int) -> None:
        self.acted.setdefault(stop_id, tick)

    def standing(self, before_tick: int) -> list[int]:
        """Stops that acted by then and were not both released and resumed."""
        over = min(self.released, self.resumed)
        return [s for s, tick in self.acted.items() if tick <= before_tick and self.epoch.get(s, over + 1) > over]


class World:
    def __init__(self) -> None:
        self.tick = 0
        self.disk: StopRecord | None = StopRecord()
        self.writing: StopRecord | None = None
        self.lives = 0
        self.comm: StopOwner | None = None
        self.gate: MotionGate | None = None
        self.board = Board()
        self.permit: tuple[Permit, int] | None = None  # at the bridge, with the tick of its arrival
        self.heard_board: tuple[int, Stp] | None = None
        self.to_comm: list[Any] = []
        self.to_bridge: list[tuple[int, Any]] = []
        self.to_board: list[tuple[str, int]] = []
        self.seen: list[tuple[int, bool]] = [(0, False)]  # epochs that people saw in permits, and whether latched
        self.presses = 0
        self.moved = False
        self.ghost = Ghost()
        self.start_comm()
        self.start_bridge()

    # --- processes

    def start_comm(self) -> None:
        if self.comm is None:
            self.lives += 1
            self.writing = None
            self.comm = stop_owner.owner(self.disk, self.lives)
            self.disk = self.comm.wanted
            self.comm = stop_owner.stored(self.comm, self.disk)

    def kill_comm(self) -> None:
        self.comm = self.writing = None

    def start_bridge(self) -> None:
        if self.gate is None:
            self.gate, self.permit, self.heard_board = MotionGate(), None, None
            self.known_to_bridge: set[int] = set()

    def kill_bridge(self) -> None:
        if self.gate is not None and self.comm is not None:
            on_disk = {stop.stop_id for stop in self.disk.stops} if self.disk is not None else set()
            pressed_elsewhere = {stop_id for stop_id in self.known_to_bridge if stop_id <= self.presses}
            for stop_id in pressed_elsewhere - on_disk:
                if self.ghost.epoch.get(stop_id, self.board.epoch + 1) > self.board.epoch:
                    self.ghost.acted.pop(stop_id, None)
        self.gate = None
        self.to_bridge.clear()

    def lose_record(self) -> None:
        if self.comm is None:
            self.disk = None

    def reset_board(self) -> None:
        before = button_press(self.board.session, self.board.count)
        self.board.reset()
        if self.board.latched & StopSourceFlag.BUTTON and before not in self.ghost.epoch:
            self.ghost.acted.pop(before, None)  # the board keeps it, under another id

    def cut_power(self) -> None:
        self.kill_comm()
        self.kill_bridge()
        self.reset_board()
        self.to_comm.clear()
        self.to_board.clear()

    # --- people

    def press(self) -> None:
        self.presses += 1
        request = StopRequest(0.0, "operator", True, stop_id=self.presses)
        self.to_comm.append(request)
        self.to_bridge.append((self.tick, request))

    def release(self, which: int) -> None:
        """What somebody saw, now or long ago."""
        epoch, _ = self.seen[-1 - which % len(self.seen)]
        self.to_comm.append(StopRequest(0.0, "operator", False, epoch=epoch))

    def resume(self, which: int) -> None:
        epoch, _ = self.seen[-1 - which % len(self.seen)]
        self.to_comm.append(epoch)

    def push_button(self) -> None:
        self.board.press(not self.board.pressed)

    # --- messages

    def deliver_comm(self, which: int, keep: bool) -> None:
        if not self.to_comm:
            return
        index = which % len(self.to_comm)
        message = self.to_comm[index] if keep else self.to_comm.pop(index)
        if self.comm is None:
            return
        before = self.comm
        if isinstance(message, BridgeReport):
            self.comm = stop_owner.on_report(before, message)
        elif isinstance(message, int):
            self.comm = stop_owner.resume(before, message)
            if not before.record.latched:
                self.ghost.resumed = max(self.ghost.resumed, message)
        elif message.latched:
            self.comm = stop_owner.press(before, Stop(message.source, message.stop_id))
        else:
            self.comm = stop_owner.release(before, message.epoch)
            self.ghost.released = max(self.ghost.released, message.epoch)
            if self.board.pressed:  # the button still says stop
                self.ghost.epoch.pop(button_press(self.board.session, self.board.count), None)
        over = self.ghost.acted.keys() - self.ghost.standing(self.tick)
        for stop in set(self.comm.record.stops) - set(before.record.stops):
            if stop.stop_id in over:  # a late repeat: it acts anew
                del self.ghost.acted[stop.stop_id]
        if self.comm.queried is None:
            for stop in self.comm.record.stops:
                self.ghost.epoch[stop.stop_id] = self.comm.record.epoch
            if {stop_owner.RESTART, stop_owner.LOST_RECORD} & set(self.comm.record.sources):
                # It stands for all that nobody knows any more
                standing = self.ghost.standing(self.tick)
                self.ghost.epoch |= dict.fromkeys(standing, self.comm.record.epoch)

    def write(self) -> None:
        """The disk begins, or is done."""
        if self.comm is None:
            return
        if self.writing is None:
            self.writing = self.comm.to_store
            return
        self.disk = self.writing
        for stop in self.disk.stops:
            self.ghost.act(stop.stop_id, self.tick)
        self.comm = stop_owner.stored(self.comm, self.writing)
        self.writing = None

    def publish_permit(self) -> None:
        comm = self.comm
        if comm is None:
            return
        known = [stop for stop in self.ghost.standing(self.tick) if stop in self.ghost.epoch]
        if comm.may_grant and known:
            raise Violation(f"granted over {known}")
        record = comm.record
        ids = tuple(stop.stop_id for stop in record.stops)
        permit = Permit(
            0.0, comm.may_grant, "", record.sources, stop_epoch=comm.epoch, stop_ids=ids, resumed=record.resumed,
            life=comm.life,
        )  # fmt: skip
        self.to_bridge.append((self.tick, permit))
        if comm.epoch:
            self.seen.append((comm.epoch, record.latched))

    def deliver_bridge(self, which: int, keep: bool) -> None:
        if not self.to_bridge:
            return
        index = which % len(self.to_bridge)
        sent, message = self.to_bridge[index] if keep else self.to_bridge.pop(index)
        if self.gate is None:
            return
        if isinstance(message, StopRequest):
            self.gate.request(message)
            self._act_at_bridge(message.stop_id)
        elif self.tick - sent <= PERMIT_TICKS:
            self.permit = (message, self.tick)
            self._may_move()
            if message.stop_epoch >= self.gate.epoch:
                self._act_at_bridge(*message.stop_ids)

    def hear_board(self) -> None:
        if self.gate is not None:
            self.heard_board = (self.board.session, self.board.report())
            self.gate.board(*self.heard_board)
            if self.board.latched & StopSourceFlag.BUTTON:
                self._act_at_bridge(button_press(self.board.session, self.board.count))

    def _act_at_bridge(self, *stop_ids: int) -> None:
        for stop_id in stop_ids:
            self.ghost.act(stop_id, self.tick)
            self.known_to_bridge.add(stop_id)

    def report(self) -> None:
        """The bridge's word to comm."""
        if self.gate is not None and self.heard_board is not None:
            stops = tuple(Stop(source, stop_id) for stop_id, source in self.gate.held.items())
            pressed = bool(self.heard_board[1].latched & StopSourceFlag.PRESSED)
            board_epoch = self.heard_board[1].epoch
            self.to_comm.append(BridgeReport(self.gate.life, self.gate.permit_epoch, board_epoch, stops, pressed))

    def _may_move(self) -> bool:
        assert self.gate is not None
        permit, came = self.permit or (None, 0)
        return self.gate.may_move(permit, (self.tick - came) * TICK_S)

    def command(self) -> None:
        """A step of the bridge towards the board."""
        if self.gate is None or self.heard_board is None:
            return
        stp = self.heard_board[1]
        if not self._may_move():
            self.to_board.append(("byte", stp.epoch))
            if self.gate.stop_sources and stp.epoch < self.gate.epoch:
                self.to_board.append(("stop", self.gate.epoch))
            return
        known = self.known_to_bridge & set(self.ghost.standing(self.tick))
        if known:
            raise Violation(f"the bridge drives over {known}")
        self.to_board += [(kind, self.gate.epoch) for kind in ("heartbeat", "release", "start")]

    def deliver_board(self, lost: bool) -> None:
        """The serial line keeps the order, and loses lines."""
        if not self.to_board:
            return
        line = self.to_board.pop(0)
        if not lost and self.board.take(line):
            self.moved = True
            standing = self.ghost.standing(self.tick - BOUND_TICKS)
            if standing:
                raise Violation(f"the board moves over {standing}")

    def next_tick(self) -> None:
        """Time goes on; what is too old on a line never arrives."""
        self.tick += 1
        self.to_board.clear()

    # --- everybody does what is theirs, nothing is lost

    def settle(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            for _ in range(2):
                self.write()
            self.publish_permit()
            while self.to_bridge:
                self.deliver_bridge(0, keep=False)
            self.hear_board()
            self.report()
            self.command()
            while self.to_board:
                self.deliver_board(lost=False)
            while self.to_comm:
                self.deliver_comm(0, keep=False)
            self.next_tick()


# What may happen next: usual things, and such that a run has only some of (swarm testing: Groce et al., ISSTA 2012)
_USUAL = ["settle", "deliver_comm", "deliver_bridge", "deliver_board", "publish_permit", "write", "hear_board"]
_USUAL += ["report", "command", "next_tick", "press", "release", "resume", "start_comm", "start_bridge"]
_RARE = ["push_button", "kill_comm", "kill_bridge", "reset_board", "cut_power", "lose_record"]
_ARGUMENTS = {"deliver_comm": 2, "deliver_bridge": 2, "deliver_board": 1, "release": 1, "resume": 1}


def interleaving(seed: int, length: int) -> int:
    """One random interleaving; how often the robot moved again after a stop. Raises Violation."""
    random = Random(seed)
    world = World()
    world.settle(3)
    moves = 2 * random.sample(_USUAL, 10) + random.sample(_RARE, 3)
    moves += random.choice((0, 4, 12)) * ["settle"] + 2 * ["press", "release", "resume", "start_comm", "start_bridge"]
    disorder, returns = random.choice((0.0, 0.1, 0.5)), 0
    for _ in range(length):
        name = random.choice(moves)
        which, keep = (random.randrange(4), True) if random.random() < disorder else (0, False)
        arguments = (which, keep)[: _ARGUMENTS.get(name, 0)] if name != "deliver_board" else (keep,)
        world.moved = False
        getattr(world, name)(*arguments)
        returns += world.moved and bool(world.ghost.acted)
    return returns
