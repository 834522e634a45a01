"""Measures the speed of this machine with a small render. Imports no Blender."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...settings.description import defaults, merged
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.file_schemas import NUMBER, TEXT, read_record
from ...support.number_text import format_count
from ...support.system import count_processors
from ..pairs.pair_folder import read_pair
from ..plans.triangle_count import count_triangles
from ..workers.job_commands import Job, render_job
from ..workers.process import Message
from .blender_abilities import query_abilities
from .estimate import ASSUMED_TRIANGLES, estimate_work
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
_MIN_BUSY_SHARE = 0.5
#: Least processor seconds of a pair whose time shows the speed: the work of the small render.
_MIN_PAIR_S = 4.0
#: The entries of ``pair.json`` that are read.
_PAIR_SHAPE = {
    "seconds": {"render": NUMBER, "write": NUMBER},
    "cpu_seconds": {"pair": NUMBER},
    "versions": {"blender": TEXT},
}


def make_small_render(device: str, denoiser: bool = True) -> Settings:
    """Make the complete settings of the small render, for a Blender with or without a denoiser."""
    quality = {"device": device, **({} if denoiser else {"denoiser": "NONE"})}
    return merged(defaults(), _SMALL_RENDER, {"quality": quality})


def read_speed(pairs: list[Path], device: str, denoiser: bool = True) -> Speed:
    """Read the speed from the pairs of ``make_small_render``. It is the speed of the fastest pair after the first,
    because other work on the machine may slow a pair down.

    At least half of the processors are assumed to be at work: if a pair took longer, other work used the processors, or
    the pair is too small for all of them. Raises IcyMoonError if the pairs cannot be read.
    """
    settings = make_small_render(device, denoiser)
    expected = estimate_work(settings).seconds(count_triangles(settings))
    try:
        facts = [read_record(pair / "pair.json", _PAIR_SHAPE, "measure again") for pair in pairs]
        times = [_read_times(each, device) for each in facts[1:]]
        busy = max(min(1.0, worked / held) for worked, held in times)
        return _make_speed(min(worked for worked, _ in times) / expected, device, facts[0], busy)
    except (OSError, IcyMoonError, ValueError, IndexError) as error:
        raise IcyMoonError(
            f"The small render that measures this machine cannot be read ({error}); try again."
        ) from None


def _read_times(facts: Mapping[str, Any], device: str) -> tuple[float, float]:
    """Read, from its ``pair.json``, the processor seconds that a pair used, and those that were at hand during its
    render."""
    held = count_processors() * (facts["seconds"]["render"] + facts["seconds"]["write"])
    return (facts["cpu_seconds"]["pair"] if device == "CPU" else held), held


def _make_speed(factor: float, device: str, facts: Mapping[str, Any], busy: float, **by: str) -> Speed:
    return Speed(
        factor,
        device,
        facts["versions"]["blender"],
        count_processors(),
        datetime.now(UTC).isoformat(timespec="minutes"),
        max(_MIN_BUSY_SHARE, busy),
        **by,
    )


def read_speed_of_pair(folder: Path) -> Speed | None:
    """Read the speed from a pair that this machine has just rendered, with all processors and no other pair beside it.

    None for a pair whose time shows little: it took less than ``_MIN_PAIR_S``, it has fewer threads than there are
    processors, shared baked light or edits by hand, or it was rendered on a graphics card, whose first pair includes a
    compilation. Raises IcyMoonError if the pair cannot be read.
    """
    pair = read_pair(folder)
    quality, facts = pair.settings.quality, read_record(folder / "pair.json", _PAIR_SHAPE, "render the pair again")
    worked, held = _read_times(facts, str(quality.device))
    limited = 0 < quality.threads < count_processors()
    if quality.device != "CPU" or limited or pair.data.get("indirect") or pair.data.get("edited_by_hand"):
        return None
    if worked < _MIN_PAIR_S:
        return None
    rig = pair.settings.rig
    return _make_speed(
        worked / estimate_work(pair.settings).seconds(ASSUMED_TRIANGLES),
        "CPU",
        facts,
        min(1.0, worked / held),
        by=f"a pair of {rig.width_px} x {rig.height_px} pixels with {format_count(quality.samples, 'sample')}",
    )


def measure_speed(blender: str, device: str, scratch: Path, hear: Callable[[Message], None]) -> Speed:
    """Render the small pair with a Blender (or a Python with bpy) into ``scratch``, and store the speed.

    Raises IcyMoonError if the render or the disk fails.
    """
    denoiser = query_abilities(blender).denoiser
    speed = read_speed(render_job(Job(scratch, make_small_render(device, denoiser)), blender, hear), device, denoiser)
    remember_speed(speed)
    return speed
