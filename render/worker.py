"""The headless worker: builds a scene, renders its pairs, says what it does in JSON lines.

The window, the command line and a scheduler all run this. A job is a JSON file:
``{"settings": {...}, "dataset": folder, "blend": file or null, "scene": name or null}``.
With ``blend`` the scene in that file is rendered as a person left it; without, it is built from
the settings alone.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from .. import properties
from ..errors import IcyMoonError
from ..nodes.ground import cost_warnings
from ..nodes.scene import Built, build, find
from ..physics.blur import blur_of
from ..settings import Settings, check, defaults, merged
from . import quality
from .plan import PlannedPair, expand
from .queue import emit
from .shoot import check_camera, check_space, is_complete, shoot

Emit = Callable[..., None]


def render_pairs(built: Built, pairs: list[PlannedPair], dataset: Path, frame: int, seconds_build: float,
                 say: Emit, again: bool = False) -> list[Path]:
    """Render the planned pairs of a built scene and return their folders.

    A pair that is already complete is not rendered again unless ``again``. ``say(type, **facts)``
    receives ``progress`` (``fraction`` of all pairs, ``message``) and ``pair`` messages.
    Raises IcyMoonError at the first failure, and if the scene shows a preview; finished pairs stay.
    """
    if built.preview:
        raise IcyMoonError("The scene shows a preview; press Build Scene and render again.")
    check_camera(built)
    check_space(dataset, pairs)
    quality.check_possible(pairs[0].settings["quality"])
    folders = []
    for k, planned in enumerate(pairs):
        label = f"Pair {k + 1} of {len(pairs)}"
        folder = planned.folder(dataset)
        if is_complete(folder) and not again:
            say("pair", id=planned.id, folder=str(folder), rendered=False, done=k + 1, total=len(pairs))
        else:
            def report(fraction: float, k: int = k, label: str = label) -> None:
                say("progress", fraction=(k + fraction) / len(pairs), message=label)

            start = time.perf_counter()
            report(0.0)
            shoot(built, planned, dataset, frame, seconds_build, report)
            say("pair", id=planned.id, folder=str(folder), rendered=True, done=k + 1, total=len(pairs),
                seconds=round(time.perf_counter() - start, 2))
        folders.append(folder)
    return folders


def _open(job: dict[str, Any], settings: Settings) -> tuple[bpy.types.Scene, Built, str]:
    """The scene to render, built, and what identifies content that the settings do not."""
    if job.get("blend"):
        bpy.ops.wm.open_mainfile(filepath=job["blend"], load_ui=False, use_scripts=False)
        scene = bpy.data.scenes.get(job["scene"])
        built = find(scene) if scene else None
        if scene is None or built is None:
            raise IcyMoonError(f"{job['blend']} holds no built Icy Moon scene; press Build Scene and render again.")
        return scene, built, built.extra
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    built = build(scene, settings)
    return scene, built, built.extra


def run(job: dict[str, Any], say: Emit = emit) -> None:
    """Do a job. Raises IcyMoonError for what a person can mend."""
    try:
        settings = merged(defaults(), check(job["settings"], "job"))
        dataset = Path(job["dataset"])
    except KeyError as error:
        raise IcyMoonError(f"The job lacks {error}; write it with Render Stereo Pair or icymoon render.") from None
    say("progress", fraction=0.0, message="Building the scene")
    for warning in [] if job.get("blend") else cost_warnings(settings):
        say("warning", message=warning)
    quality.check_possible(settings["quality"])
    blur_of(settings)  # refused before anything is built
    start = time.perf_counter()
    scene, built, extra = _open(job, settings)
    for warning in built.warnings:
        say("warning", message=warning)
    repeat = int(job.get("repeat", 0))
    pairs = expand(settings, extra + (f" repeat {repeat}" if repeat else ""))
    folders = render_pairs(built, pairs, dataset, scene.frame_current, time.perf_counter() - start, say,
                           bool(job.get("again")))
    say("done", folders=[str(f) for f in folders])


def main(arguments: list[str]) -> int:
    """Run the job in a file (the one argument) and end the process: 0 if all went well, 1 with an ``error`` message.

    Leaves by ``os._exit``, since the Blender module may crash or hang when the interpreter ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # stop at once; what is not finished has no final name
    status = 1
    try:
        properties.register()
        run(json.loads(Path(arguments[0]).read_text(encoding="utf-8")))
        status = 0
    except IcyMoonError as error:
        emit("error", message=str(error))
    except MemoryError:
        emit("error", message="There is not enough memory; lower mesh.most, terrain.resolution or the image size.")
    except Exception as error:
        import traceback
        traceback.print_exc()
        emit("error", message=f"The worker failed ({type(error).__name__}: {error}); please report this.")
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
