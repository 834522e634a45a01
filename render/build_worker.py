"""The program that builds a scene in a separate Blender, so that the window stays usable.

    __main__.py build JOB.json SCENE.blend

The job has the form of a job of ``worker``; only its settings count.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ..nodes.build_scene import build_scene
from ..nodes.stored_build import write_build
from ..settings.description import check, defaults, merged
from ..support.printer import emit
from .worker import run_to_exit
from .workers.job_commands import read_job
from .workers.out_of_memory import describe_shortage


def write_scene(job: dict[str, Any], path: Path, send: Callable[..., None] = emit) -> None:
    """Build the scene of a job's settings and write it to a .blend file; ``send(type, **facts)`` receives ``progress``
    and ``done`` messages. Raises IcyMoonError if the scene cannot be built."""
    send("progress", fraction=0.1, message="Building the scene")
    built = build_scene(bpy.context.scene, merged(defaults(), check(job["settings"], "job")))
    send("progress", fraction=0.9, message="Writing the scene")
    write_build(built, path)
    send("done", scene=str(path))


def main(arguments: list[str]) -> int:
    """Build the scene of a job, write it to a .blend file, and end the process (``run_to_exit``). Arguments: the job's
    file and the .blend file."""
    job: dict[str, Any] = {}

    def run() -> None:
        job.update(read_job(Path(arguments[0])))
        write_scene(job, Path(arguments[1]))

    run_to_exit(run, lambda: describe_shortage(merged(defaults(), check(job.get("settings", {}), "job"))))
