"""`indoor-mapping simulate`: every node of the robot in one thread and one simulated time, as fast as the CPU allows.

The same nodes as on the boards, connected by a `LocalMesh` and stepped in a fixed order; below them the same world,
firmware and serial line as in `local`. What works beside them, and the recorder, do so on another core, at simulated
times that are fixed: a run repeats to the bit from its seed.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from math import ceil, floor
from typing import TypeVar

from common.bus import LocalBus, LocalMesh
from common.config import Config, with_camera
from common.errors import StartError
from common.memory import keep_what_is_there
from common.messages.mission import Operation, OperatorCommand, Outcome, PlannerView
from common.messages.topics import OPERATION, PERMIT, PLAN, Topic
from common.node import Agenda, FileNode, Node
from offboard.evaluate.run_text import HEADLINE, figures, progress
from offboard.evaluate.summary import RunFacts, StepTimes, write_summary
from offboard.simulator.camera.camera_frames import CameraFrames
from offboard.simulator.electronics.avr_board import AvrBoard
from offboard.simulator.electronics.board import Board, FirmwareBuildError, HostBoard
from offboard.simulator.physics.world import STEP_S
from offboard.simulator.run.options import RunOptions, floor_json, load_world, prepare_folder, site_section
from offboard.simulator.run.recorder_apart import RecorderApart
from offboard.simulator.run.route import RouteDriver
from offboard.simulator.run.side_workers import SideWorkers, apart, in_thread
from offboard.simulator.run.simulation import Simulation
from offboard.simulator.stopwatch import BESIDE, BUS, REST, WORLD, Stopwatch
from onboard.bridge.bridge import Bridge
from onboard.comm.comm import Comm
from onboard.comm.outbox import Outbox
from onboard.mmu.mmu import MappingUnit, carrier_of
from onboard.planner.planner import Planner
from onboard.poi.poi import Poi

TIME_LIMIT_S = 4 * 3600.0
RECORD_LIMIT_S = 5.0  # how long the end of the mission may take into the database
PROGRESS_S = 5.0  # of wall time
_ROUNDING_S = 1e-9

P = TypeVar("P")


class _Bus(LocalBus):
    """Encodes and delivers on an account of its own, not on that of the node that publishes."""

    def __init__(self, stopwatch: Stopwatch, mesh: LocalMesh, name: str, boot_id: int) -> None:
        super().__init__(mesh, name, boot_id)
        self._stopwatch = stopwatch

    def publish(self, topic: Topic[P], payload: P, *, news: bool = True) -> None:
        before = self._stopwatch.enter(BUS)
        super().publish(topic, payload, news=news)
        self._stopwatch.enter(before)


class _Slot:
    """A node on the mesh, when it is due and how long its steps took (processor time, as in `common/process.py`)."""

    def __init__(self, node: Node, bus: LocalBus, stopwatch: Stopwatch) -> None:
        self.node, self.bus = node, bus
        self.frozen = False
        self.durations_s: list[float] = []
        self.due_s = -_ROUNDING_S  # unless the bus is woken, or the file has something, before that
        self.has_file = isinstance(node, FileNode)
        self._agenda, self._stopwatch = Agenda(node, 0.0), stopwatch
        bus.wake_on(node.wakes_on)

    def look_at_file(self, now_s: float) -> None:
        """Something has arrived at the node's file."""
        if self._agenda.fileno() is not None:
            self._agenda.file_has(now_s)
            self.due_s = self._agenda.due_s - _ROUNDING_S

    def run(self, now_s: float) -> None:
        """To be called when the bus is woken, and when the node is due."""
        agenda, bus = self._agenda, self.bus
        if bus.woken:
            agenda.woken, bus.woken = True, False
            self.due_s = agenda.due_s - _ROUNDING_S
        if now_s < self.due_s or self.frozen:
            return
        agenda.begin_step()
        before = self._stopwatch.enter(self.node.name)
        began_s = time.thread_time()
        due_s = self.node.step(bus, now_s)
        self.durations_s.append(time.thread_time() - began_s)
        self._stopwatch.enter(before)
        agenda.stepped(now_s, due_s)
        self.due_s = agenda.due_s - _ROUNDING_S


class Lockstep:
    """World and nodes of one run. `advance` steps all of them by 5 ms."""

    def __init__(
        self, simulation: Simulation, nodes: list[Node], seed: int = 0, beside: Callable[[], None] = lambda: None
    ) -> None:
        """`beside` does the work that has a process of its own on the robot; no node's step times contain it."""
        self.simulation, self._beside = simulation, beside
        self.stopwatch = stopwatch = simulation.stopwatch
        self.mesh = LocalMesh(seed, partial(_Bus, stopwatch))
        self.operator = self.mesh.endpoint("command_center")
        self.slots = [_Slot(node, self.mesh.endpoint(node.name), stopwatch) for node in nodes]
        self._with_file = [slot for slot in self.slots if slot.has_file]

    @property
    def now_s(self) -> float:
        return self.simulation.world.time_s

    def advance(self, count: int = 1) -> bool:
        """One step of the world, STEP_S, or up to `count` while no node is due; then of every node that is due.

        Returns whether a node was due.
        """
        simulation = self.simulation
        simulation.run(1 if count == 1 else min(count, self._steps_to_next()))
        self.mesh.now_s = now_s = simulation.world.time_s
        if simulation.port.readable:
            for slot in self._with_file:
                slot.look_at_file(now_s)
        stepped = False
        for slot in self.slots:
            if now_s >= slot.due_s or slot.bus.woken:
                stepped = True
                slot.run(now_s)
        if stepped:
            self.stopwatch.enter(BESIDE)
            self._beside()
            self.stopwatch.enter(REST)
        return stepped

    def _steps_to_next(self) -> int:
        """How many steps of the world until a node is due, as far as is known; at least one."""
        due_s = min([slot.due_s for slot in self.slots])
        if any(slot.bus.woken for slot in self.slots):
            return 1
        return max(1, ceil((due_s - self.now_s) / STEP_S))

    def run_until(self, condition: Callable[[], bool], limit_s: float) -> bool:
        """Advance until the condition holds (True) or so much simulated time is over (False).

        The condition is looked at after every step of the world.
        """
        while not condition():
            if self.now_s > limit_s:
                return False
            self.advance()
        return True

    def run_nodes_until(self, condition: Callable[[], bool], limit_s: float) -> bool:
        """As `run_until`; the condition is looked at after every step of a node, and depends on messages only."""
        while not condition():
            stepped = False
            while not stepped:
                left = floor((limit_s - self.now_s) / STEP_S) + 1
                if left <= 0:
                    return False
                stepped = self.advance(left)
        return True

    def close(self) -> None:
        for slot in self.slots:
            slot.node.close()
        self.simulation.close()


def _board(build_of: str) -> Board:
    try:
        return AvrBoard() if build_of == "avr" else HostBoard()
    except FirmwareBuildError as error:
        raise StartError(str(error)) from error


def build(
    options: RunOptions,
    recorder: Node | None = None,
    beside: SideWorkers | None = None,
    stopwatch: Stopwatch | None = None,
) -> Lockstep:
    """The whole robot in its building, powered on; raises StartError. `beside`: in this thread where not given."""
    floor, events = load_world(options)
    workers = beside or in_thread()
    simulation = Simulation(
        floor,
        _board(options.board),
        start_index=options.start,
        seed=options.seed,
        errors=options.errors,
        camera=options.camera,
        events=events,
        stopwatch=stopwatch,
    )
    config = Config(poi=site_section(options))
    # Without a recorder nobody would ever acknowledge its messages
    outbox = None if recorder is None else Outbox(None, config.comm.outbox_limit_mb * 1_000_000, new_id=options.seed)
    if simulation.camera is not None:
        config = with_camera(config)
    nodes: list[Node] = [
        Bridge(lambda: simulation.port),
        MappingUnit(workers.back_end, carrier_of(config)),
        Planner(workers.deliberator, config.has_camera)
        if options.route is None
        else RouteDriver(options.route, floor, lambda: simulation.world.truth),
        Comm(config.comm, outbox=outbox),
    ]
    if recorder is not None:
        nodes.append(recorder)
    if simulation.camera is not None:
        nodes.append(Poi(config.poi, CameraFrames(simulation.camera), workers.reading(config.poi)))
    return Lockstep(simulation, nodes, options.seed, workers.work)


def simulate(options: RunOptions) -> int:
    """A whole mission; prints its progress, writes the run folder. The exit code is that of its outcome."""
    folder = prepare_folder(options)
    stopwatch = Stopwatch()
    recorder = RecorderApart(folder, stopwatch)
    robot = build(options, recorder, apart(stopwatch, options.reading_s), stopwatch)
    keep_what_is_there()
    stopwatch.restart()
    began_s = time.monotonic()
    try:
        view = _mission(robot, began_s)
        robot.run_nodes_until(lambda: recorder.finished, robot.now_s + RECORD_LIMIT_S)
    finally:
        robot.close()
    outcome = view.outcome if view is not None else Outcome.NONE
    robot.simulation.write_truth(folder)
    steps = {slot.node.name: StepTimes.of(slot.durations_s) for slot in robot.slots}
    facts = RunFacts(
        floor=options.floor.stem,
        seed=options.seed,
        start=options.start,
        options={key: value for key, value in options.as_dict().items() if key != "out"},
        outcome=outcome,
        reason=view.detail if view is not None else "the modules did not become ready",
        blacklisted=view.blacklisted if view is not None else (),
        simulated_time_s=round(robot.now_s, 3),
        wall_time_s=round(time.monotonic() - began_s, 3),
        steps=steps,
    )
    summary = write_summary(folder, facts, floor_json(options))
    _print(_closing_line(summary, robot, folder))
    return outcome.exit_code


def _mission(robot: Lockstep, began_s: float) -> PlannerView | None:
    permit = robot.operator

    def granted() -> bool:
        newest = permit.latest(PERMIT)
        return newest is not None and newest.granted

    if not robot.run_nodes_until(granted, limit_s=60.0):
        return None
    robot.operator.publish(OPERATION, OperatorCommand(robot.now_s, Operation.START))
    printed_s = began_s

    def finished() -> bool:
        nonlocal printed_s
        view = robot.operator.latest(PLAN)
        if view is not None and time.monotonic() - printed_s > PROGRESS_S:
            printed_s = time.monotonic()
            pace = robot.now_s / (printed_s - began_s)
            _print(f"{progress(robot.now_s, view, permit.latest(PERMIT))}, {pace:.0f} times real time")
        return view is not None and view.outcome.ends_mission

    robot.run_nodes_until(finished, TIME_LIMIT_S)
    robot.run_nodes_until(lambda: False, robot.now_s + 0.3)
    return robot.operator.latest(PLAN)


def _closing_line(summary: dict[str, object], robot: Lockstep, folder: object) -> str:
    robot.simulation.world.book_time()
    measured = ", ".join(figures(summary, (*HEADLINE, "ratio")))
    wall_s = summary["wall_time_s"]
    assert isinstance(wall_s, float)
    return (
        f"{summary['outcome'] if summary['finished'] else 'NOT finished'} after {robot.now_s:.0f} s in {wall_s:.1f} s "
        f"({robot.now_s / max(wall_s, 1e-3):.1f} times real time): {measured}\n"
        f"wall time: {_shares(robot.stopwatch.spent_s())}\nrun folder {folder}"
    )


def _shares(spent_s: Mapping[str, float]) -> str:
    """Every account; those of the world together, and then one by one."""
    world = {account: spent_s[account] for account in WORLD if account in spent_s}
    others = {account: seconds for account, seconds in spent_s.items() if account not in world}

    def listed(accounts: Mapping[str, float]) -> str:
        return ", ".join(f"{account} {seconds:.1f} s" for account, seconds in sorted(accounts.items(), key=_dearest))

    return f"world {sum(world.values()):.1f} s ({listed(world)}), {listed(others)}"


def _dearest(account: tuple[str, float]) -> float:
    return -account[1]


def _print(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
