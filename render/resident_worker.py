"""The resident worker: it renders one job after another, and each scene reuses parts of the previous one.

For each job the starter puts a file into the worker's inbox, with the number of the job as name and the path of the
job's file as content. The worker's standard input stays empty; its end means that the starter has ended.
"""

from __future__ import annotations

import itertools
import time
from functools import partial
from pathlib import Path
from typing import NoReturn

from ..settings.topics.scene import typed
from ..support.errors import IcyMoonError
from ..support.files import read_text
from ..support.printer import emit
from .resident_scenes import ResidentScenes
from .worker import run_to_exit
from .workers.job_commands import read_job
from .workers.out_of_memory import describe_shortage

_POLL_S = 0.02


def main(arguments: list[str]) -> NoReturn:
    """Render the jobs that appear in a folder, the one argument, until this process is ended."""
    run_to_exit(partial(_serve, Path(arguments[0])), lambda: "There is not enough memory to start Blender.")


def _serve(inbox: Path) -> None:
    """Render the jobs of an inbox. Each job ends with a message: ``done`` with its ``folders``, or ``error``."""
    scenes = ResidentScenes()
    emit("ready")
    for number in itertools.count(1):
        file = inbox / str(number)
        while not file.is_file():
            time.sleep(_POLL_S)
        job = read_job(Path(read_text(file)))
        settings = typed(job["settings"])
        try:
            folders = scenes.render(settings, Path(job["dataset"]), bool(job.get("again")), emit)
        except IcyMoonError as error:
            emit("error", message=str(error))
        except MemoryError:
            emit("error", message=describe_shortage(settings))
            scenes.close()
            scenes = ResidentScenes()
        else:
            emit("done", folders=[str(folder) for folder in folders])
