"""What the processes of a local run are started with: the files of the run, robot.toml, arguments. Options -> both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from common.config import BridgeSection, Config, MeshSection, VisualizerSection, apart, with_camera, with_process
from common.config_file import config_text
from common.node_loop import STEPS_SUFFIX
from deploy.local.ports import refuse_second_mesh, reserve_port, usual_port
from deploy.local.process_table import SIMULATOR
from offboard.simulator.run.options import RunOptions, site_section
from onboard.comm.stop_record import RECORD_NAME, StopRecord, write_record
from onboard.mmu.map.map_file import MAP_NAME
from onboard.planner.zones.zone_file import ZONES_NAME


@dataclass(frozen=True, slots=True)
class RunPaths:
    """Where the files of a local run are."""

    folder: Path  # of the run
    frames: Path  # socket of the simulated camera; its path must be short, which a run folder's need not be

    @property
    def work(self) -> Path:
        """What only the processes need."""
        return self.folder / "process"

    @property
    def serial(self) -> Path:
        return self.work / "serial"

    @property
    def config(self) -> Path:
        return self.work / "robot.toml"

    def clear(self) -> None:
        """What an earlier run left for its processes goes; the robot is a new one, which nobody has stopped yet."""
        left_overs = (self.serial, self.work / MAP_NAME, self.work / ZONES_NAME, *self.work.glob(f"*{STEPS_SUFFIX}"))
        for left_over in left_overs:
            left_over.unlink(missing_ok=True)
        write_record(self.work / RECORD_NAME, StopRecord())


def mesh_config(options: RunOptions, paths: RunPaths) -> Config:
    """Written to robot.toml too. A headless run takes ports of its own, so that several go side by side.

    Raises StartError where a mesh of this robot runs at the usual port already.
    """
    wanted = (None, None) if options.headless else (usual_port(), VisualizerSection().port)
    router, page = (reserve_port(port) for port in wanted)
    config = Config(
        mesh=MeshSection(f"tcp/127.0.0.1:{router}", f"tcp/127.0.0.1:{reserve_port()}"),
        bridge=BridgeSection(serial_port=str(paths.serial)),
        visualizer=VisualizerSection(port=page),
        poi=replace(site_section(options), source=f"unix:{paths.frames}"),
    )
    if options.ros:
        config = with_process(config, "ros")
    if options.apart:
        config = apart(config)
    if not options.headless and router != usual_port():
        refuse_second_mesh(Config())
    if options.camera != "off":
        config = with_camera(config)
    paths.config.write_text(config_text(config), encoding="utf-8")
    return config


def process_arguments(name: str, options: RunOptions, paths: RunPaths) -> list[str]:
    arguments = ["--config", str(paths.config), "--log-dir", str(paths.work)]
    if options.speed != 1.0:
        arguments += ["--clock", "shared"]
    if name in ("recorder", "visualizer", SIMULATOR):
        arguments += ["--run-dir", str(paths.folder)]
    if name == SIMULATOR:
        arguments += ["--floor", str(options.floor.resolve()), "--start", str(options.start)]
        arguments += ["--seed", str(options.seed), "--errors", options.errors, "--speed", str(options.speed)]
        arguments += ["--camera", options.camera, "--frames", str(paths.frames)]
        if options.events is not None:
            arguments += ["--events", str(options.events.resolve())]
    return arguments
