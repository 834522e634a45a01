"""The headless worker: builds scenes, renders their pairs, reports progress in JSON lines.

The window, the command line and a scheduler all run this. A job is a JSON file, see ``job_commands.Job``: the
pairs of some settings, of a scene in a .blend file as the user left it, or of a list.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import bpy

from ..nodes import painted_errors
from ..nodes.build_scene import Built, find_built, make_build_facts, separate_from_copies
from ..settings.blender import scene_properties
from ..settings.description import check, defaults, merged, overlay
from ..settings.topics.scene import Settings
from ..support.errors import DiskError, IcyMoonError, find_first_line
from ..support.printer import emit
from ..support.system import end_at_interrupt
from . import baked_light
from .pairs.pair_folder import is_complete
from .plans.planned_pair import PlannedPair, expand_headings
from .render_pair import check_space, render_pair
from .scene_source import FixedScene, ScenesFromSettings
from .workers.first_use_of_card import FirstSample, report_while_compiling
from .workers.job_commands import read_job, read_planned_pairs
from .workers.out_of_memory import describe_shortage
from .workers.pair_claims import Claims
from .workers.shared_light import SharedLight

Send = Callable[..., None]
#: A driver may take minutes before the first sample on a graphics card.
_COMPILING_MESSAGE = "the driver may be compiling for the graphics card, which takes minutes at its first use"


def render_pairs(
    built: Built,
    pairs: list[PlannedPair],
    dataset: Path,
    frame: int,
    seconds_build: float,
    send: Send,
    again: bool = False,
) -> list[Path]:
    """Render the planned pairs of a built scene and return their folders, see ``render_from``.

    Raises IcyMoonError at the first failure, and if the scene shows a preview; finished pairs stay.
    """
    painted_errors.clear_painted(built.scene)  # the user's own material could read files that no id counts
    with FixedScene(built, frame, seconds_build) as source:
        render_from(source, pairs, dataset, send, again)
    return [planned.folder(dataset) for planned in pairs]


def render_from(
    source: FixedScene | ScenesFromSettings,
    pairs: list[PlannedPair],
    dataset: Path,
    send: Send,
    again: bool = False,
    keep_going: bool = False,
) -> None:
    """Render planned pairs, each in the scene that ``source`` has for it.

    A pair that is already complete is not rendered again unless ``again``. ``send(type, **facts)`` receives
    ``progress`` (``fraction`` of all pairs, ``message``, ``pair``) and ``pair`` messages. With ``keep_going`` it
    receives ``error`` messages that name their ``pair``, and pairs that another process is rendering are left to it;
    otherwise both raise IcyMoonError. Errors of the disk are always raised.
    """
    check_space(dataset, pairs, again)
    claims = Claims(dataset)
    shared = SharedLight(dataset, claims)
    first_sample = FirstSample()
    try:
        for k, planned in enumerate(pairs):
            with claims.hold(planned.id) as mine:
                if not mine and not keep_going:
                    raise IcyMoonError(f"Another process is rendering pair {planned.id}; wait for it.")
                try:
                    if mine:
                        _render_one(source, planned, dataset, send, shared, again, k, len(pairs), first_sample)
                except IcyMoonError as error:
                    if claims.is_lost(planned.id) and keep_going:
                        continue  # the new holder has also removed the files that this process had begun
                    if isinstance(error, DiskError) or not keep_going:
                        raise
                    send("error", message=str(error), pair=planned.id)
    finally:
        claims.close()


def _render_one(
    source: FixedScene | ScenesFromSettings,
    planned: PlannedPair,
    dataset: Path,
    send: Send,
    shared: SharedLight,
    again: bool,
    k: int,
    total: int,
    first_sample: FirstSample,
) -> None:
    label = f"Pair {k + 1} of {total}"
    folder = planned.folder(dataset)

    def tell(fraction: float, message: str = label) -> None:
        send("progress", fraction=(k + fraction) / total, message=message, pair=planned.id, of_pair=fraction)

    def report(fraction: float) -> None:
        shared.claims.report_progress()
        if fraction > 0:
            first_sample.note()
        tell(fraction)

    rendered = again or not is_complete(folder)
    start = time.perf_counter()
    if rendered:
        report(0.0)
        # An earlier version may have accepted settings that this one refuses.
        check(planned.settings, f"Pair {planned.id}")
        built, scene, build_s = source.prepare(planned)
        assert source.rays is not None
        with (
            report_while_compiling(first_sample, partial(tell, 0.0, f"{label}: {_COMPILING_MESSAGE}"))
            if planned.settings.quality.device == "GPU" and not first_sample.has_come
            else nullcontext()
        ):
            indirect = baked_light.provide_baked_light(built, scene, planned, shared)
            is_lost = partial(shared.claims.is_lost, planned.id)
            render_pair(built, scene, planned, dataset, build_s, report, is_lost, source.rays, again, indirect)
        shared.release_stated_light(folder)
    seconds = round(time.perf_counter() - start, 2)
    send("pair", id=planned.id, folder=str(folder), rendered=rendered, done=k + 1, total=total, seconds=seconds)


def list_job_pairs(job: dict[str, Any]) -> list[PlannedPair]:
    """List the pairs of a job; the job's number of threads, if any, replaces the pairs' own."""
    if job.get("pairs"):
        threads = check({"quality": {"threads": job["threads"]}} if job.get("threads") is not None else {}, "job")
        return [replace(pair, settings=overlay(pair.settings, threads)) for pair in read_planned_pairs(job)]
    settings = merged(defaults(), check(job["settings"], "job"))
    # Each pair is built from its own settings, so no rig has to be turned.
    return [
        PlannedPair(pair.id, pair.settings, 0.0)
        for pair in expand_headings(settings, make_build_facts(settings) + _repeat_text(job))
    ]


def _first_settings(job: dict[str, Any]) -> Settings:
    """Read the settings of a job's scene, or of its first pair."""
    if job.get("pairs"):
        return read_planned_pairs({**job, "pairs": job["pairs"][:1]})[0].settings
    return merged(defaults(), check(job.get("settings", {}), "job"))


def _repeat_text(job: dict[str, Any]) -> str:
    """Return the text that distinguishes the pairs of another repeat; empty for the first."""
    return f" repeat {job['repeat']}" if job.get("repeat") else ""


def run_job(job: dict[str, Any], send: Send = emit) -> None:
    """Run a job, see ``job_commands.read_job``. Raises IcyMoonError for errors that a user can fix."""
    dataset, again = Path(job["dataset"]), bool(job.get("again"))
    send("progress", fraction=0.0, message="Building the scene")
    if job.get("blend"):
        built, frame, pairs = _open_blend(job)
        render_pairs(built, pairs, dataset, frame, 0.0, send, again)
    else:
        pairs = list_job_pairs(job)
        with ScenesFromSettings(lambda warning: send("warning", message=warning), _repeat_text(job)) as source:
            render_from(source, pairs, dataset, send, again, bool(job.get("pairs")))
    send("done", folders=[str(pair.folder(dataset)) for pair in pairs if is_complete(pair.folder(dataset))])


def _open_blend(job: dict[str, Any]) -> tuple[Built, int, list[PlannedPair]]:
    """Open a .blend file. Return its built scene, its current frame, and its pairs."""
    try:
        bpy.ops.wm.open_mainfile(filepath=job["blend"], load_ui=False, use_scripts=False)
    except RuntimeError as error:
        why = find_first_line(error)
        raise IcyMoonError(f"{job['blend']} cannot be opened ({why}); save the scene and render again.") from None
    scene = bpy.data.scenes.get(job["scene"])
    built = find_built(scene) if scene else None
    if scene is None or built is None:
        raise IcyMoonError(f"{job['blend']} contains no built Icy Moon scene; press Build Scene and render again.")
    separate_from_copies(built)
    settings = merged(defaults(), check(job["settings"], "job"))
    return built, scene.frame_current, expand_headings(settings, built.extra + _repeat_text(job))


def main(arguments: list[str]) -> int:
    """Run the job in a file (the one argument) and end the process (``run_to_exit``)."""
    job: dict[str, Any] = {}

    def run() -> None:
        job.update(read_job(Path(arguments[0])))
        run_job(job)

    run_to_exit(run, lambda: describe_shortage(_first_settings(job)))


def run_to_exit(run: Callable[[], None], describe_no_memory: Callable[[], str]) -> NoReturn:
    """Run a program in Blender and end the process: status 0 for success, 1 with an ``error`` message.

    The process ends by ``os._exit``, since the Blender module may crash or hang when the interpreter ends.
    """
    end_at_interrupt()  # unfinished files have no final name, so an interrupt may end the process
    status = 1
    try:
        scene_properties.register()
        run()
        status = 0
    except IcyMoonError as error:
        emit("error", message=str(error))
    except MemoryError:
        emit("error", message=describe_no_memory(), crash=True)
    except Exception as error:
        import traceback

        traceback.print_exc()
        emit("error", message=f"The worker failed ({type(error).__name__}: {error}); please report this.", crash=True)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
