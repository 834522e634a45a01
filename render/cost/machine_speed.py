"""The speed of this machine as ``measure_speed`` found it, and the file that keeps it. Imports no Blender.

Two numbers per computer, device, version of Blender and number of processors: the processor seconds that a pair took
over the seconds that ``estimate`` expects, and the share of the processors that were at work. The file is in the user's
cache folder, so that the window and the command line share it.
"""

from __future__ import annotations

import platform
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...support.cache_folder import own_cache_folder
from ...support.errors import IcyMoonError
from ...support.file_schemas import COUNT, POSITIVE, TABLE, TEXT, find_fault, read_record
from ...support.files import write_json
from ...support.system import count_processors


@dataclass(frozen=True)
class Speed:
    """A measured speed: the ``factor`` of a pair's processor seconds here over the seconds that ``estimate`` expects,
    and the share of the processors that are ``busy`` meanwhile. With a graphics card all processors count as busy."""

    factor: float
    device: str
    blender: str
    processors: int
    measured: str  # moment, UTC, ISO 8601
    busy: float = 1.0

    @property
    def basis(self) -> str:
        """Where it comes from, in words."""
        return f"this machine, Blender {self.blender}, measured {self.measured[:10]}"


#: How that is kept. What versions before ``busy`` kept is measured again.
_SPEED = {"factor": POSITIVE, "device": TEXT, "blender": TEXT, "processors": COUNT, "measured": TEXT, "busy": POSITIVE}
#: Share of the processors at work on a machine that was not measured.
_BUSY = 0.85


def to_wall_seconds(processor_s: float, speed: Speed | None) -> float:
    """Seconds on the clock of ``processor_s`` processor seconds, which ``speed.factor`` has already corrected."""
    return processor_s / (count_processors() * (speed.busy if speed else _BUSY))


def _speed_file() -> Path:
    return own_cache_folder() / "speed.json"


def _read_speeds() -> dict[str, Any]:
    """All speeds that are kept; none if the file cannot be read."""
    try:
        return dict(read_record(_speed_file(), TABLE, "delete it"))
    except (OSError, IcyMoonError):
        return {}


def _speed_key(device: str, blender: str, count: int) -> str:
    return f"{platform.node()} {device} {count} {blender}"


def recall_speed(device: str, blender: str = "") -> Speed | None:
    """The speed of this computer's ``device`` (CPU or GPU) with as many processors as there are now, in one version of
    Blender or, if none is named, the one measured last; None if it was not measured."""
    known = [
        (key, Speed(**{name: entry[name] for name in _SPEED}))
        for key, entry in _read_speeds().items()
        if not find_fault(entry, _SPEED)
    ]
    found = [
        speed
        for key, speed in known
        if key == _speed_key(device, speed.blender, count_processors()) and blender in ("", speed.blender)
    ]
    return max(found, key=lambda speed: speed.measured, default=None)


def remember_speed(speed: Speed) -> None:
    """Keep a speed for all later estimates. Raises IcyMoonError if the disk refuses."""
    write_json(
        _speed_file(), {**_read_speeds(), _speed_key(speed.device, speed.blender, speed.processors): asdict(speed)}
    )
