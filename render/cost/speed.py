"""How fast this machine is, measured once with a small render and remembered. Imports no Blender.

What a machine took of the seconds that ``cost`` expects is one number, kept per computer, device, version of Blender
and number of processors in a file of the person's cache folder, so that window and command line share it.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...errors import IcyMoonError
from ...files import user_path, write_json
from ...records import COUNT, NUMBER, POSITIVE, TABLE, TEXT, fault, read_record
from ...settings.description import Settings, defaults, merged
from ...system import cache_folder, processors
from ..workers.job import Job, render_job
from ..workers.process import Message
from .abilities import ask
from .estimate import triangles_of, work_of

#: Names another cache folder, for tests and for people who keep theirs elsewhere.
FOLDER_VARIABLE = "ICYMOON_CACHE"
#: What is rendered: all that a pair has (both eyes, interreflection, denoiser, truth, files), in some 4 processor
#: seconds. The first pair of a process pays for what a graphics card compiles, so only the others count.
_PROBE: dict[str, dict[str, Any]] = {
    "rig": {"width_px": 320, "height_px": 240}, "mesh": {"error_px": 4.0, "edge_px": 24.0},
    "surface": {"model": "LAMBERT"}, "quality": {"samples": 8, "denoiser": "OIDN"}, "dataset": {"headings": 3}}


@dataclass(frozen=True)
class Speed:
    """What was measured: processor seconds that a pair takes here over those that ``cost`` expects."""

    factor: float
    device: str
    blender: str
    processors: int
    measured: str  # moment, UTC, ISO 8601

    @property
    def basis(self) -> str:
        """Where it comes from, for people."""
        return f"this machine, Blender {self.blender}, measured {self.measured[:10]}"


#: How that is kept.
_SPEED = {"factor": POSITIVE, "device": TEXT, "blender": TEXT, "processors": COUNT, "measured": TEXT}

#: What is read of a rendered pair.
_PAIR = {"seconds": {"render": NUMBER, "write": NUMBER}, "cpu_seconds": {"pair": NUMBER}, "versions": {"blender": TEXT}}

_chosen = ""


def choose_folder(path: str) -> None:
    """Keep what is measured in another folder than the person's cache, whatever asks; empty for that cache."""
    global _chosen
    _chosen = path


def folder() -> Path:
    """The cache folder of Icy Moon, which need not exist: of the environment, the one chosen, the person's own."""
    if given := os.environ.get(FOLDER_VARIABLE) or _chosen:
        return user_path(given, FOLDER_VARIABLE).absolute()
    return cache_folder() / "icymoon"


def _file() -> Path:
    return folder() / "speed.json"


def _kept() -> dict[str, Any]:
    """All that is remembered; a file that cannot be read is as good as none."""
    try:
        return dict(read_record(_file(), TABLE, "delete it"))
    except (OSError, IcyMoonError):
        return {}


def _key(device: str, blender: str, count: int) -> str:
    return f"{platform.node()} {device} {count} {blender}"


def remembered(device: str, blender: str = "") -> Speed | None:
    """The speed of this computer's ``device`` (CPU or GPU) with as many processors as there are now, in one version of
    Blender or, if none is named, the one measured last; None if there is none."""
    known = [(key, Speed(**{name: entry[name] for name in _SPEED})) for key, entry in _kept().items()
             if not fault(entry, _SPEED)]
    found = [speed for key, speed in known
             if key == _key(device, speed.blender, processors()) and blender in ("", speed.blender)]
    return max(found, key=lambda speed: speed.measured, default=None)


def remember(speed: Speed) -> None:
    """Keep a speed for all later estimates. Raises IcyMoonError if the disk refuses."""
    write_json(_file(), {**_kept(), _key(speed.device, speed.blender, speed.processors): asdict(speed)})


def probe(device: str, denoiser: bool = True) -> Settings:
    """Complete settings of the small render, for a Blender that has a denoiser or not."""
    return merged(defaults(), _PROBE, {"quality": {"device": device, **({} if denoiser else {"denoiser": "NONE"})}})


def speed_of(pairs: list[Path], device: str, denoiser: bool = True) -> Speed:
    """What rendered pairs of ``probe`` say: the fastest but the first, for other work may slow any of them down.

    All processors are taken to be at work half the time at least: where a pair took longer, other work had them, or
    the pair is too small for so many. Raises IcyMoonError if they cannot be read.
    """
    settings = probe(device, denoiser)
    expected = work_of(settings).seconds(triangles_of(settings))
    try:
        facts = [read_record(pair / "pair.json", _PAIR, "measure again") for pair in pairs]
        taken = [processors() * (each["seconds"]["render"] + each["seconds"]["write"]) for each in facts[1:]]
        if device == "CPU":
            taken += [2.0 * each["cpu_seconds"]["pair"] for each in facts[1:]]
        return Speed(min(taken) / expected, device, facts[0]["versions"]["blender"], processors(),
                     datetime.now(UTC).isoformat(timespec="minutes"))
    except (OSError, IcyMoonError, ValueError, IndexError) as error:
        raise IcyMoonError(f"The small render that measures this machine cannot be read ({error}); try "
                           "again.") from None


def measure(blender: str, device: str, scratch: Path, hear: Callable[[Message], None]) -> Speed:
    """Render the probe with a Blender (or a Python with bpy) into ``scratch``, and remember how fast that was.

    Raises IcyMoonError if the render or the disk fails.
    """
    denoiser = ask(blender).denoiser
    speed = speed_of(render_job(Job(scratch, probe(device, denoiser)), blender, hear), device, denoiser)
    remember(speed)
    return speed
