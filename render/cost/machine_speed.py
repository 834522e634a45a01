"""The measured speed of this machine (``measure_speed``), and the file that stores it. Imports no Blender.

The file has two numbers per computer, device, version of Blender and number of processors: the processor seconds of a
pair over the seconds that ``estimate`` expects, and the share of the processors at work. The file is in the user's
cache folder, so the window and the command line share it.
"""

from __future__ import annotations

import platform
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...support.cache_folder import own_cache_folder
from ...support.errors import IcyMoonError
from ...support.file_schemas import COUNT, POSITIVE, TABLE, TEXT, Maybe, find_fault, read_record
from ...support.files import write_json
from ...support.system import count_processors


@dataclass(frozen=True)
class Speed:
    """A measured speed.

    ``factor`` is the processor seconds of a pair here over the seconds that ``estimate`` expects. ``busy`` is the share
    of the processors at work meanwhile; with a graphics card all processors count as busy. ``by`` is the render that
    was timed, in words.
    """

    factor: float
    device: str
    blender: str
    processors: int
    measured: str  # moment, UTC, ISO 8601
    busy: float = 1.0
    by: str = "a small render"

    @property
    def basis(self) -> str:
        """The source of the speed, in words."""
        return f"this machine, Blender {self.blender}, measured {self.measured[:10]} by {self.by}"


#: Content of the stored entry. Entries of versions before ``busy`` are measured again.
_SPEED_SHAPE = {
    "factor": POSITIVE,
    "device": TEXT,
    "blender": TEXT,
    "processors": COUNT,
    "measured": TEXT,
    "busy": POSITIVE,
    "by": Maybe(TEXT),
}
#: Share of the processors at work on a machine that was not measured.
_ASSUMED_BUSY_SHARE = 0.85


def to_wall_seconds(processor_s: float, speed: Speed | None) -> float:
    """Convert ``processor_s`` processor seconds, which ``speed.factor`` has already corrected, to wall seconds."""
    return processor_s / (count_processors() * (speed.busy if speed else _ASSUMED_BUSY_SHARE))


def _speed_file() -> Path:
    return own_cache_folder() / "speed.json"


def _read_speeds() -> dict[str, Any]:
    """Read all stored speeds; empty if the file cannot be read."""
    try:
        return dict(read_record(_speed_file(), TABLE, "delete it"))
    except (OSError, IcyMoonError):
        return {}


def _speed_key(device: str, blender: str, count: int) -> str:
    return f"{platform.node()} {device} {count} {blender}"


def recall_speed(device: str, blender: str = "") -> Speed | None:
    """Recall the speed of this computer's ``device`` (CPU or GPU) with the present number of processors in one version
    of Blender. Without ``blender``, it is the speed measured last. None without a measurement."""
    known = [
        (key, Speed(**{name: entry[name] for name in _SPEED_SHAPE if name in entry}))
        for key, entry in _read_speeds().items()
        if not find_fault(entry, _SPEED_SHAPE)
    ]
    found = [
        speed
        for key, speed in known
        if key == _speed_key(device, speed.blender, count_processors()) and blender in ("", speed.blender)
    ]
    return max(found, key=lambda speed: speed.measured, default=None)


def remember_speed(speed: Speed) -> None:
    """Store a speed for all later estimates. Raises IcyMoonError if the file cannot be written."""
    write_json(
        _speed_file(), {**_read_speeds(), _speed_key(speed.device, speed.blender, speed.processors): asdict(speed)}
    )
