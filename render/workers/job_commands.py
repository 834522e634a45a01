"""The commands that run our code in another Python or Blender, and the job files of workers. Imports no Blender."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...settings.description import Restorer
from ...settings.shared_settings import add_shared, find_shared, remove_shared
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.file_schemas import COUNT, FLAG, PATH, TABLE, TEXT, WHOLE, Each, Maybe, read_record
from ...support.files import absolute_path, explain_disk_errors
from ...support.system import is_python, remove_folder
from ...support.temporary_folders import make_scratch_folder
from ...support.version import ROOT
from ..pairs.dataset_file_names import check_id
from ..plans.planned_pair import PlannedPair
from .pair_claims import Claims
from .process import Message, Process, describe_end


def python_command(python: str, *arguments: str) -> list[str]:
    """Return the command that runs ``icymoon`` verbs in a Python interpreter."""
    return [python, str(ROOT / "__main__.py"), *arguments]


def blender_command(executable: str, *arguments: str) -> list[str]:
    """Return the command that runs ``icymoon`` verbs in a Blender, or in a Python with ``bpy``."""
    if is_python(executable):
        return python_command(executable, *arguments)
    return [
        executable,
        "-b",
        "--factory-startup",
        "--python-exit-code",
        "1",
        "--python",
        str(ROOT / "__main__.py"),
        "--",
        *arguments,
    ]


#: The shape of a job file.
JOB_SHAPE = {
    "settings": Maybe(Each(TABLE, TEXT), null=True),
    "dataset": PATH,
    "again": Maybe(FLAG),
    "repeat": Maybe(WHOLE),
    "blend": Maybe(PATH, null=True),
    "scene": Maybe(TEXT, null=True),
    "threads": Maybe(COUNT, null=True),
    "shared": Maybe(Each(TABLE, TEXT)),
    "pairs": Maybe(Each({"id": TEXT, "settings": Each(TABLE, TEXT)})),
}


def read_job(file: Path) -> dict[str, Any]:
    """Read a job file. Raises IcyMoonError if the file is not a job."""
    fix = "write it with Render Stereo Pair or icymoon render"
    try:
        job = dict(read_record(file, JOB_SHAPE, fix))
    except FileNotFoundError:
        raise IcyMoonError(f"There is no job {file}; {fix}.") from None
    if not job.get("pairs") and job.get("settings") is None:
        raise IcyMoonError(f"{file}: settings is missing; {fix}.")
    if job.get("blend") and not job.get("scene"):
        raise IcyMoonError(f"{file}: scene is missing; {fix}.")
    return job


def read_planned_pairs(job: Mapping[str, Any]) -> list[PlannedPair]:
    """Read the planned pairs of a job, which stores common settings and each pair's changes to them."""
    restore, shared = Restorer(), job.get("shared", {})
    return [
        PlannedPair(check_id(pair["id"], "The job"), restore(add_shared(pair["settings"], shared), "job"), 0.0)
        for pair in job["pairs"]
    ]


class Job:
    """A render job on disk for a worker; ``remove`` it when the worker has ended."""

    def __init__(
        self,
        dataset: Path,
        settings: Settings | None = None,
        *,
        pairs: Sequence[PlannedPair] = (),
        scene: str | None = None,
        again: bool = False,
        threads: int | None = None,
        repeat: int = 0,
    ) -> None:
        """Write the job file: the pairs of complete settings, or planned pairs. Any of the planned pairs may fail.

        With ``scene`` the caller saves the .blend to ``blend``. ``threads`` takes the place of quality.threads. Pairs
        of another ``repeat`` differ only in their name and in the noise of their light paths.
        """
        self.dataset = dataset
        self.folder = make_scratch_folder()
        self.blend = self.folder / "scene.blend"
        self.file = self.folder / "job.json"
        shared = find_shared(pair.settings for pair in pairs)
        with explain_disk_errors("write a job to", self.folder):
            job: Mapping[str, Any] = {
                "settings": settings,
                "dataset": str(dataset),
                "again": again,
                "repeat": repeat,
                "blend": str(self.blend) if scene else None,
                "scene": scene,
                "threads": threads,
                "shared": shared,
                "pairs": [{"id": pair.id, "settings": remove_shared(pair.settings, shared)} for pair in pairs],
            }
            self.file.write_text(json.dumps(job), encoding="utf-8")

    def discard(self) -> None:
        """Delete the job's own files."""
        remove_folder(self.folder)

    def remove(self) -> None:
        """Delete the job's own files, and the unfinished files of a stopped worker."""
        self.discard()
        Claims(self.dataset).remove_leftovers()


def render_job(job: Job, blender: str, hear: Callable[[Message], None]) -> list[Path]:
    """Render a job with a worker and return the pair folders; ``hear`` receives every message.

    The job is removed at the end, also after an error. Raises IcyMoonError with the worker's own error if it fails.
    """
    folders: list[Path] = []
    failure = ""
    try:
        process = Process(blender_command(blender, "worker", str(job.file)))
        try:
            for message in process.wait_for_messages():
                hear(message)
                if message["type"] == "error":
                    failure = message["message"]
                elif message["type"] == "done":
                    folders = [Path(folder) for folder in message["folders"]]
        finally:
            process.stop()
    finally:
        job.remove()
    if failure or not folders:
        raise IcyMoonError(failure or f"Blender {describe_end(process)}")
    return folders


def resolve_dataset_folder(text: str, blend_folder: str | None = None) -> Path:
    """Resolve the folder that ``dataset.folder`` names, by ``absolute_path``."""
    return absolute_path(text, "dataset.folder", blend_folder)
