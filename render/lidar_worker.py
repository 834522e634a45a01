"""The program that scans scenes by a laser scanner, in a separate Blender.

    __main__.py scan JOB.json FOLDER LIDAR.toml POSE ROWS COLUMNS RAYS RETURNS PLY

The job is a job of ``worker``. For each of its pairs, the folder of its id gets ``lidar.npz``, ``lidar.json`` and,
if PLY is 1, ``lidar.ply``. POSE is x,y,z,w,x,y,z: the sensor's place in metres and its rotation as a quaternion, or
empty for a sensor at the left eye. Empty values leave what the scanner has.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from ..formats.lidar_file import LidarFile, change_lidar, read_lidar
from ..formats.lidar_points import write_points, write_returns
from ..nodes.rig import find_eye_poses
from ..physics.camera.rotations import quaternion
from ..physics.lidar.backscatter import tabulate_scene
from ..physics.lidar.instrument import SensorPose, make_pose, mount_on_rig
from ..physics.lidar.returns import Reported, Returns
from ..rays.lidar import scan_whole
from ..support.errors import IcyMoonError
from ..support.files import explain_disk_errors, write_json
from ..support.printer import emit
from .geometry_worker import lower_quality
from .ray_stage import CannotTrace
from .scene_source import ScenesFromSettings
from .worker import list_job_pairs, run_to_exit
from .workers.job_commands import read_job

_NO_MEMORY_MESSAGE = "There is not enough memory for the scan; give it fewer beams, or make the ground coarser."


@dataclass(frozen=True)
class ScanRequest:
    """A scanner, its pose (None: at the left eye), and whether to write PLY."""

    lidar: LidarFile
    pose: SensorPose | None
    ply: bool


def run_job(job: dict[str, Any], folder: Path, asked: ScanRequest, send: Callable[..., None] = emit) -> None:
    """Scan the scene of each pair of a job. Raises IcyMoonError for errors that a user can fix."""
    pairs = list_job_pairs(job)
    with ScenesFromSettings(lambda warning: send("warning", message=warning)) as source:
        for k, planned in enumerate(pairs):
            send("progress", fraction=k / len(pairs), message=f"Scan {k + 1} of {len(pairs)}")
            built, _, _ = source.prepare(lower_quality(planned))
            assert source.rays is not None
            try:
                stage = source.rays.prepare()
            except CannotTrace as reason:
                raise IcyMoonError(
                    f"The scene cannot be scanned by rays, because {reason}; change the scene so that its truth is "
                    "traced by rays."
                ) from None
            eyes = find_eye_poses(built.camera.matrix_world, built.camera.data.stereo.interocular_distance)
            pose = asked.pose or mount_on_rig(eyes["left"], asked.lidar.aim)
            laws = tabulate_scene(planned.settings)
            found = scan_whole(stage.ground, stage.ground_tracer, asked.lidar.instrument, pose, laws)
            _write_scan(folder / planned.id, asked, pose, found)
    send("done", folders=[str(folder / planned.id) for planned in pairs])


def _write_scan(folder: Path, asked: ScanRequest, pose: SensorPose, found: Returns) -> None:
    instrument = asked.lidar.instrument
    with explain_disk_errors("write to", folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_returns(folder / "lidar.npz", found, instrument.pattern)
    if asked.ply:
        write_points(folder / "lidar.ply", found)
    hit = len(np.unique(found.beam))
    write_json(
        folder / "lidar.json",
        {
            "title": asked.lidar.title,
            "pattern": instrument.pattern.kind,
            "rows": instrument.pattern.rows,
            "columns": instrument.pattern.columns,
            "rays": instrument.sub_rays,
            "wavelength_nm": instrument.wavelength_m * 1e9,
            "pulse_uj": instrument.pulse_j * 1e6,
            "sensor_to_world": pose.matrix.tolist(),
            "position_m": pose.position_m.tolist(),
            "quaternion_wxyz": quaternion(pose.rotation).tolist(),
            "axes": "x forward, y left, z up; the world has x east, y north, z up",
            "beams": instrument.pattern.count,
            "beams_without_return": instrument.pattern.count - hit,
            "returns": len(found),
        },
    )


def parse_request(words: list[str]) -> ScanRequest:
    """The scanner, the pose and the files that the words after the folder ask for. Raises IcyMoonError."""
    file, pose, rows, columns, rays, returns, ply = words
    lidar = change_lidar(
        read_lidar(Path(file)),
        int(rows) if rows else None,
        int(columns) if columns else None,
        int(rays) if rays else None,
        cast(Reported, returns) if returns else None,
    )
    numbers = [float(word) for word in pose.split(",")] if pose else []
    return ScanRequest(lidar, make_pose(numbers[:3], numbers[3:]) if numbers else None, ply == "1")


def main(arguments: list[str]) -> int:
    """Run the job in a file, and end the process. Arguments: the job's file, the folder to write to, and those of
    ``parse_request``."""
    job, folder = Path(arguments[0]), Path(arguments[1])
    run_to_exit(lambda: run_job(read_job(job), folder, parse_request(arguments[2:])), lambda: _NO_MEMORY_MESSAGE)
