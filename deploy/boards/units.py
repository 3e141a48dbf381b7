"""systemd units of a board's processes, from the configuration: what `deploy/local/supervisor.py` does for `local`.

`Config`, board -> file name -> text. A process is ready when its nodes have their buses; it is restarted when it ends
or when one of its loops no longer steps (`common/service_notify.py`). The target starts and stops all. Pure.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import reduce

from common.config import Config
from common.constants import STARTUP_GRACE_S
from common.environment import PROCESS_ENVIRONMENT
from common.modules import ON_ROBOT
from deploy.boards.layout import CONFIG, PYTHON, PYTHONPATH, STATE, TARGET, UNIT_PREFIX, USER, unit_name
from deploy.local.process_table import program_of
from deploy.local.supervisor import RESTART_PAUSE_S

WATCHDOG_S = 5.0  # a loop steps at least every second; comm has withdrawn the permit long before
_STOP_S = 5.0  # to write down what is held

Lines = Iterable[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class _Needs:
    """What a module needs of its board; a process of several needs the sum."""

    memory_mb: int  # above it the process is killed and restarted, before the board has none left
    rank: int = 2  # 0 is started first
    cpu_weight: int = 100  # against other units, 100 being usual (systemd.resource-control(5))
    nice: int = 0
    groups: tuple[str, ...] = ()
    devices: tuple[str, ...] = ()  # as DeviceAllow names them

    def __add__(self, other: _Needs) -> _Needs:
        return _Needs(
            self.memory_mb + other.memory_mb,
            min(self.rank, other.rank),
            max(self.cpu_weight, other.cpu_weight),
            min(self.nice, other.nice),
            self.groups + other.groups,
            self.devices + other.devices,
        )


# The kinds of ports that an Arduino or a UART appears as, and what a camera's driver opens
_SERIAL = ("char-ttyACM", "char-ttyUSB", "char-ttyS", "char-ttyAMA")
_CAMERA = ("char-video4linux", "char-media", "char-dma_heap")
# Bridge and comm come first: without their heartbeats and permits the robot stands. What shares comm's process, and
# work beside the loops, lower their own priority (common/priority.py). 512 MB are on the BeagleBone
_NEEDS = {
    "bridge": _Needs(64, rank=0, cpu_weight=1000, nice=-10, groups=("dialout",), devices=_SERIAL),
    "comm": _Needs(64, rank=1, cpu_weight=500, nice=-5),
    "mmu": _Needs(224),
    "planner": _Needs(96),
    "poi": _Needs(1024, groups=("video",), devices=_CAMERA),
}

_HARDENING = {
    "NoNewPrivileges": "yes",
    "CapabilityBoundingSet": "",
    "ProtectSystem": "strict",
    "ProtectHome": "yes",
    "PrivateTmp": "yes",
    "ProtectProc": "invisible",
    "ProtectKernelTunables": "yes",
    "ProtectKernelModules": "yes",
    "ProtectKernelLogs": "yes",
    "ProtectControlGroups": "yes",
    "ProtectClock": "yes",
    "ProtectHostname": "yes",
    "RestrictAddressFamilies": "AF_INET AF_INET6 AF_UNIX AF_NETLINK",
    "RestrictNamespaces": "yes",
    "RestrictRealtime": "yes",
    "RestrictSUIDSGID": "yes",
    "LockPersonality": "yes",
    "SystemCallArchitectures": "native",
    "SystemCallFilter": "@system-service",
    "UMask": "0027",
}
_ENVIRONMENT = PROCESS_ENVIRONMENT | {
    "PYTHONPATH": PYTHONPATH,
    "PYTHONFAULTHANDLER": "1",  # where it was stuck goes to the journal
}


def unit_texts(config: Config, board: str) -> dict[str, str]:
    """File name -> text; `board` as `robot.toml` names it. A service for each of the robot's processes there, in the
    order of their start, and the target of all; empty where none of them runs. What people look at on the laptop, they
    start themselves.
    """
    processes: tuple[str, ...] = config.boards[board].processes
    needs = {process: _needs(process) for process in processes if process.split("+")[0] in ON_ROBOT}
    ordered = sorted(needs, key=lambda process: needs[process].rank)
    services = {unit_name(process): _service(process, needs[process], _before(process, needs)) for process in ordered}
    return services | {TARGET: _target(services)} if services else {}


def niceness(process: str) -> int:
    """With which a process of the robot runs on its board; 0 is usual, what is below comes first."""
    return _needs(process).nice


def _needs(process: str) -> _Needs:
    return reduce(_Needs.__add__, (_NEEDS[module] for module in process.split("+")))


def _before(process: str, needs: Mapping[str, _Needs]) -> list[str]:
    """Units of the processes that are started before this one."""
    return [unit_name(other) for other in needs if needs[other].rank < needs[process].rank]


def _service(process: str, needs: _Needs, before: Iterable[str]) -> str:
    unit = {
        "Description": f"Indoor mapping: {' and '.join(process.split('+'))}",
        "PartOf": TARGET,
        "After": " ".join(("network.target", *before)),
        "StartLimitIntervalSec": "0",
    }
    service = {
        "Type": "notify",
        "ExecStart": f"{PYTHON} -m {' '.join(program_of(process))} --config {CONFIG} --log-dir {STATE}",
        "User": USER,
        "SupplementaryGroups": " ".join(needs.groups),
        "StateDirectory": UNIT_PREFIX,
        # All processes of the board share the folder, so none may take it along
        "RuntimeDirectory": UNIT_PREFIX,
        "RuntimeDirectoryPreserve": "yes",
        "Restart": "always",
        "RestartSec": f"{RESTART_PAUSE_S:g}",
        "WatchdogSec": f"{WATCHDOG_S:g}",
        "TimeoutStartSec": f"{STARTUP_GRACE_S:g}",
        "TimeoutStopSec": f"{_STOP_S:g}",
        "KillMode": "mixed",  # what works beside the loops is ended by their process
        "LimitCORE": "0",
        "MemoryMax": f"{needs.memory_mb}M",
        "CPUWeight": str(needs.cpu_weight),
        "Nice": str(needs.nice),
    }
    # In quotes, or systemd would end a value at its first blank
    environment = [("Environment", f'"{name}={value}"') for name, value in _ENVIRONMENT.items()]
    # No device of its own: then all of them are out of sight
    private = [] if needs.devices else [("PrivateDevices", "yes")]
    devices = [("DevicePolicy", "closed"), *(("DeviceAllow", f"{device} rw") for device in needs.devices)]
    return _text(
        {
            "Unit": unit.items(),
            "Service": (*service.items(), *environment, *_HARDENING.items(), *private, *devices),
        }
    )


def _target(services: Iterable[str]) -> str:
    unit = {"Description": "Indoor mapping: all processes of this board", "Wants": " ".join(services)}
    return _text({"Unit": unit.items(), "Install": [("WantedBy", "multi-user.target")]})


def _text(sections: Mapping[str, Lines]) -> str:
    parts = ["\n".join((f"[{name}]", *(f"{key}={value}" for key, value in lines))) for name, lines in sections.items()]
    return "\n\n".join(parts) + "\n"
