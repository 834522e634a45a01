"""Measures the speed of this machine with a small render. Imports no Blender."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...settings.description import defaults, merged
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.file_schemas import NUMBER, TEXT, read_record
from ...support.system import count_processors
from ..plans.triangle_count import count_triangles
from ..workers.job_commands import Job, render_job
from ..workers.process import Message
from .blender_abilities import query_abilities
from .estimate import estimate_work
from .machine_speed import Speed, remember_speed

#: The small render has all parts of a pair (both eyes, interreflection, denoiser, truth, files) and takes about 4
#: processor seconds. The first pair of a process includes the compilation for a graphics card, so only the later pairs
#: count.
_SMALL_RENDER: dict[str, dict[str, Any]] = {
    "rig": {"width_px": 320, "height_px": 240},
    "mesh": {"error_px": 4.0, "edge_px": 24.0},
    "surface": {"model": "LAMBERT"},
    "quality": {"samples": 8, "denoiser": "OIDN"},
    "dataset": {"headings": 3},
}
#: Least share of the processors that is assumed to be at work.
_LEAST_BUSY_SHARE = 0.5
#: The entries of ``pair.json`` that are read.
_PAIR_SHAPE = {
    "seconds": {"render": NUMBER, "write": NUMBER},
    "cpu_seconds": {"pair": NUMBER},
    "versions": {"blender": TEXT},
}


def make_small_render(device: str, denoiser: bool = True) -> Settings:
    """Complete settings of the small render, for a Blender with or without a denoiser."""
    quality = {"device": device, **({} if denoiser else {"denoiser": "NONE"})}
    return merged(defaults(), _SMALL_RENDER, {"quality": quality})


def read_speed(pairs: list[Path], device: str, denoiser: bool = True) -> Speed:
    """The speed from the pairs of ``make_small_render``: from the fastest pair after the first, because other work on
    the machine may slow a pair down.

    At least half of the processors are assumed to be at work: if a pair took longer, other work used the processors, or
    the pair is too small for all of them. Raises IcyMoonError if the pairs cannot be read.
    """
    settings = make_small_render(device, denoiser)
    expected = estimate_work(settings).seconds(count_triangles(settings))
    try:
        facts = [read_record(pair / "pair.json", _PAIR_SHAPE, "measure again") for pair in pairs]
        held = [count_processors() * (each["seconds"]["render"] + each["seconds"]["write"]) for each in facts[1:]]
        worked = [each["cpu_seconds"]["pair"] for each in facts[1:]] if device == "CPU" else held
        busy = max(min(1.0, own / whole) for own, whole in zip(worked, held, strict=True))
        return Speed(
            min(worked) / expected,
            device,
            facts[0]["versions"]["blender"],
            count_processors(),
            datetime.now(UTC).isoformat(timespec="minutes"),
            max(_LEAST_BUSY_SHARE, busy),
        )
    except (OSError, IcyMoonError, ValueError, IndexError) as error:
        raise IcyMoonError(
            f"The small render that measures this machine cannot be read ({error}); try again."
        ) from None


def measure_speed(blender: str, device: str, scratch: Path, hear: Callable[[Message], None]) -> Speed:
    """Render the small pair with a Blender (or a Python with bpy) into ``scratch``, and store the speed.

    Raises IcyMoonError if the render or the disk fails.
    """
    denoiser = query_abilities(blender).denoiser
    speed = read_speed(render_job(Job(scratch, make_small_render(device, denoiser)), blender, hear), device, denoiser)
    remember_speed(speed)
    return speed
