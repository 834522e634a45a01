"""The program that projects patterns on scenes by rays, in a separate Blender.

    __main__.py project JOB.json FOLDER PROJECTOR.json

The job is a job of ``worker``. For each of its pairs, the folder of its id gets ``projected.npz``, see
``projected_light``. PROJECTOR.json has the projector, its pattern and the rays of a pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..nodes.rig import find_eye_poses
from ..physics.camera.eyes import make_camera_with_eyes
from ..physics.projector.device import Projector
from ..physics.projector.patterns import Pattern
from ..rays.projector import trace_patterns
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.file_schemas import COUNT, TABLE, read_record
from ..support.files import explain_disk_errors, write_atomically
from ..support.printer import emit
from .geometry_worker import lower_quality
from .pairs.pair_folder import EYES
from .ray_truth import make_rendered_eye
from .scene_source import ScenesFromSettings
from .worker import list_job_pairs, run_to_exit
from .workers.job_commands import read_job

_NO_MEMORY_MESSAGE = "There is not enough memory for the patterns; render smaller images, or give fewer patterns."


@dataclass(frozen=True)
class ProjectRequest:
    """A projector, its pattern, and the number of rays across and down each pixel."""

    projector: Projector
    pattern: Pattern
    samples: int


def run_job(job: dict[str, Any], folder: Path, asked: ProjectRequest, send: Callable[..., None] = emit) -> None:
    """Project the patterns on the scene of each pair of a job. Raises IcyMoonError for errors that a user can fix."""
    pairs, patterns = list_job_pairs(job), asked.pattern.make(asked.projector)
    with ScenesFromSettings(lambda warning: send("warning", message=warning)) as source:
        for k, planned in enumerate(pairs):
            send("progress", fraction=k / len(pairs), message=f"Project {k + 1} of {len(pairs)}")
            built, _, _ = source.prepare(lower_quality(planned))
            assert source.rays is not None
            stage = source.rays.require("Patterns cannot be projected")
            lens, camera = built.camera.data, make_camera_with_eyes(planned.settings)
            poses = find_eye_poses(built.camera.matrix_world, lens.stereo.interocular_distance)
            place = asked.projector.place(poses["left"])
            found: dict[str, Any] = {}
            for eye in EYES:
                seen = trace_patterns(
                    stage,
                    make_rendered_eye(False, camera, eye, poses[eye]),
                    asked.projector,
                    place,
                    patterns,
                    (lens.clip_start, lens.clip_end),
                    asked.samples,
                )
                found |= {f"{eye}_share": seen.share, f"{eye}_place": seen.place}
            refuse_dark([found[f"{eye}_share"] for eye in EYES])
            _write(
                folder / planned.id,
                {**found, "pose": place, "mean": patterns.mean(axis=(1, 2)) * asked.projector.share_of_cone},
            )
    send("done", folders=[str(folder / planned.id) for planned in pairs])


def refuse_dark(shares: Sequence[Array]) -> None:
    """Raise IcyMoonError if a projector lights no pixel of any eye, by its shares of direct light (any shape)."""
    if not any((share > 0).any() for share in shares):
        raise IcyMoonError(
            "The pattern lights nothing that the cameras see; turn the projector to the ground by --aim, move it by "
            "--place, or widen its field by --width-deg."
        )


def _write(folder: Path, arrays: dict[str, Any]) -> None:
    with explain_disk_errors("write to", folder):
        folder.mkdir(parents=True, exist_ok=True)

    def write(part: Path) -> None:
        with part.open("wb") as stream:
            np.savez(stream, **arrays)

    write_atomically(folder / "projected.npz", write)


def read_request(path: Path) -> ProjectRequest:
    """Read the request from a file of ``icymoon projector``. Raises IcyMoonError for values that no projector has."""
    data = read_record(path, {"projector": TABLE, "pattern": TABLE, "samples": COUNT}, "run icymoon projector again")
    try:
        return ProjectRequest(Projector(**data["projector"]), Pattern(**data["pattern"]), data["samples"])
    except TypeError as error:
        raise IcyMoonError(f"{path} is not of this version ({error}); run icymoon projector again.") from None


def main(arguments: list[str]) -> int:
    """Run the job in a file, and end the process. Arguments: the job's file, the folder to write to, and the file of
    the projector."""
    job, folder, file = map(Path, arguments)
    run_to_exit(lambda: run_job(read_job(job), folder, read_request(file)), lambda: _NO_MEMORY_MESSAGE)
