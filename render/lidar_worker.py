"""The program that scans scenes by a laser scanner, in a separate Blender.

    __main__.py scan JOB.json FOLDER LIDAR.toml REQUEST

The job is a job of ``worker``. For each of its pairs, the folder of its id gets ``lidar.npz`` and ``lidar.json``,
and with waveforms ``lidar.wdp``. REQUEST is JSON, see ``workers.lidar_request``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..formats.lidar_file import LidarFile, read_lidar
from ..formats.lidar_points import ReturnWriter, check_room
from ..formats.wave_packets import FILE_NAME as WAVEFORMS
from ..formats.wave_packets import PacketWriter
from ..nodes.built_scene import Built
from ..nodes.rig import find_eye_poses
from ..nodes.surface.sun_inputs import Sun
from ..physics.camera.rotations import quaternion
from ..physics.lidar.backscatter import AlbedoMap, Backscatter, find_clean_albedos, has_patches, tabulate_scene
from ..physics.lidar.digitiser import Digitiser, make_digitiser
from ..physics.lidar.instrument import SensorPose, make_pose, mount_on_rig
from ..physics.lidar.light_in_ice import Medium
from ..physics.lidar.measured_returns import Sensing
from ..physics.lidar.noise_streams import Effects
from ..physics.lidar.scan_patterns import ScanPattern
from ..physics.lidar.scene_light import find_scene_media, find_sunlight_1_s
from ..physics.light.sunlight import BANDS_M
from ..rays.enclosure import find_enclosure
from ..rays.lidar import ScannedBeams, scan_and_measure
from ..rays.stereo_truth import Stage
from ..support.errors import IcyMoonError
from ..support.files import write_json
from ..support.labels import ROCK, TERRAIN
from ..support.printer import emit
from ..support.system import remove
from .geometry_worker import lower_quality
from .ground_files import make_frame_facts
from .ground_maps import find_extent, make_materials
from .pairs.dataset_file_names import is_regular_file
from .scene_source import ScenesFromSettings
from .worker import list_job_pairs, run_to_exit
from .workers.job_commands import read_job
from .workers.lidar_request import ScanRequest

_NO_MEMORY_MESSAGE = "There is not enough memory for the scan; make the ground coarser."


def run_job(
    job: dict[str, Any], folder: Path, lidar: LidarFile, asked: ScanRequest, send: Callable[..., None] = emit
) -> None:
    """Scan the scene of each pair of a job. Raises IcyMoonError for errors that a user can fix."""
    pairs, lidar = list_job_pairs(job), asked.change(lidar)
    check_room(folder, lidar.instrument.pattern.count, asked.waveforms or 0)
    with ScenesFromSettings(lambda warning: send("warning", message=warning)) as source:
        for k, planned in enumerate(pairs):
            send("progress", fraction=k / len(pairs), message=f"Scan {k + 1} of {len(pairs)}")
            built, scene, _ = source.prepare(lower_quality(planned))
            albedo = None if "patches" in asked.without else _map_albedo(built, scene, lidar, folder / planned.id)
            assert source.rays is not None
            stage = source.rays.require("The scene cannot be scanned")

            def report(share: float, k: int = k) -> None:
                send("progress", fraction=(k + share) / len(pairs), message=f"Scan {k + 1} of {len(pairs)}")

            _scan_scene(folder / planned.id, built, stage, lidar, asked, albedo, report)
    send("done", folders=[str(folder / planned.id) for planned in pairs])


def _map_albedo(built: Built, scene: bpy.types.Scene, lidar: LidarFile, folder: Path) -> AlbedoMap | None:
    """Map the albedo of a scene in the band next to the laser's wavelength, rendered from above. None where ground and
    rocks have one albedo each. A temporary image is in ``folder``."""
    if not has_patches(built.settings):
        return None
    extent = find_extent(built, None)
    band = int(np.argmin(np.abs(np.array(BANDS_M) - lidar.instrument.wavelength_m)))
    albedo = make_materials(built, scene, folder, extent)[band]
    return AlbedoMap(albedo, extent.cell_m, extent.west_m, extent.north_m, find_clean_albedos(built.settings))


def _scan_scene(
    folder: Path,
    built: Built,
    stage: Stage,
    lidar: LidarFile,
    asked: ScanRequest,
    albedo: AlbedoMap | None,
    report: Callable[[float], object],
) -> None:
    """Scan one built scene into its folder; ``report`` receives the finished share of the beams."""
    eyes = find_eye_poses(built.camera.matrix_world, built.camera.data.stereo.interocular_distance)
    pose = make_pose(asked.pose[:3], asked.pose[3:]) if asked.pose else mount_on_rig(eyes["left"], lidar.aim)
    _refuse_enclosed(stage, pose)
    laws = tabulate_scene(built.settings)
    sensing, words = _find_sensing(built, lidar, asked, laws)
    digitiser = make_digitiser(lidar.detector, lidar.instrument, asked.waveforms) if asked.waveforms else None
    scanned = scan_and_measure(
        stage.ground, stage.ground_tracer, lidar.instrument, pose, laws, sensing, albedo, digitiser
    )
    counts = _write_scan(folder, scanned, lidar.instrument.pattern, digitiser, report)
    facts = _describe_scan(lidar, pose) | counts | words | {"albedo": _describe_albedo(built, albedo)}
    write_json(folder / "lidar.json", facts | {"site": make_frame_facts(built.settings, built.ground)})


def _write_scan(
    folder: Path,
    scanned: Iterable[ScannedBeams],
    pattern: ScanPattern,
    digitiser: Digitiser | None,
    report: Callable[[float], object],
) -> dict[str, Any]:
    """Write the returns of a scan, and its waveforms if there is a digitiser. Returns the facts on both."""
    with ExitStack() as stack:
        writer = stack.enter_context(ReturnWriter(folder, pattern))
        packets = None if digitiser is None else stack.enter_context(PacketWriter(folder, digitiser))
        counts: dict[str, Any] = dict(
            _write_batches(writer, packets, scanned, lambda beams: report(beams / pattern.count))
        )
        writer.finish(folder / "lidar.npz")
        if packets is None:
            if is_regular_file(folder / WAVEFORMS):
                remove(folder / WAVEFORMS)
            return counts
        return counts | {"waveforms": packets.finish()}


def _describe_albedo(built: Built, albedo: AlbedoMap | None) -> str:
    if albedo is not None:
        return f"of each place, as seen from above on cells of {albedo.cell_m:.3g} m, in the image's nearest band"
    return "patches left out, as asked" if has_patches(built.settings) else "one for the ground and one for rocks"


def _refuse_enclosed(stage: Stage, pose: SensorPose) -> None:
    within = find_enclosure(stage.ground, stage.ground_tracer, pose.position_m)
    if within is not None:
        x, y, z = pose.position_m.tolist()
        where = "inside a rock" if within == ROCK else "under the ground"
        raise IcyMoonError(f"The sensor at ({x:.6g}, {y:.6g}, {z:.6g}) m is {where}; give another --position.")


def _find_sensing(
    built: Built, lidar: LidarFile, asked: ScanRequest, laws: dict[int, Backscatter]
) -> tuple[Sensing, dict[str, Any]]:
    """Find the media, detector and effects of a scan. Return them, and facts on them for the scan's file."""
    settings, instrument = built.settings, lidar.instrument
    media: dict[int, Medium] = {}
    words = dict.fromkeys(("terrain", "rocks"), "left out, as asked")
    if "ice" not in asked.without:
        media, words = find_scene_media(settings, instrument.wavelength_m * 1e9, asked.grain_m, asked.density_kg_m3)
    photons_1_s, sunlight = 0.0, "left out, as asked"
    if "sunlight" not in asked.without:
        height = Sun.from_lamp(built.sun, built.sun.matrix_world).direction[2]
        photons_1_s, sunlight = find_sunlight_1_s(settings, instrument, lidar.filter_nm, height, laws[TERRAIN])
    effects = Effects(**{name: name not in asked.without for name in vars(Effects())})
    seed = int(settings.dataset.seed) if asked.seed is None else asked.seed
    sensing = Sensing(media, lidar.detector, photons_1_s, effects, seed, asked.scan)
    facts: dict[str, Any] = {"light_in_ice": words, "detector": "none"}
    if lidar.detector is not None:
        facts["detector"] = describe_detector(lidar.detector) | {
            "sunlight": sunlight,
            "left_out": [name for name in vars(Effects()) if name in asked.without],
            "seed": seed,
            "scan": asked.scan,
        }
    return sensing, facts


def describe_detector(detector: Any) -> dict[str, Any]:
    """Describe the kind and the figures of a detector, for a file."""
    figures = {key: None if value == np.inf else value for key, value in asdict(detector).items()}
    return {"kind": type(detector).__name__, **figures}


def _write_batches(
    writer: ReturnWriter,
    packets: PacketWriter | None,
    scanned: Iterable[ScannedBeams],
    report: Callable[[int], object],
) -> dict[str, int]:
    """Write a scan, and return its counts; ``report`` receives the number of beams so far."""
    counts = dict.fromkeys(("beams", "beams_without_return", "returns"), 0)
    for each in scanned:
        made = each.packets
        writer.add(each.returns, each.beside, each.alarms, None if made is None else (made.returns, made.alarms))
        if packets is not None and made is not None:
            packets.add(made.samples, made.gain)
        counts["beams"] += each.beams
        counts["beams_without_return"] += each.empty
        counts["returns"] += len(each.returns)
        if each.alarms is not None:
            lost = int(np.isnan(each.beside["measured_range_m"]).sum())
            counts["lost_returns"] = counts.get("lost_returns", 0) + lost
            counts["false_alarms"] = counts.get("false_alarms", 0) + len(each.alarms.beam)
        report(counts["beams"])
    return counts


def _convert_unit(value: float, per_unit: float) -> float:
    """Convert a value to another unit, as a user wrote it: 3 ns stored as 3e-9 s is 3, and not 3.0000000000000004."""
    return float(f"{value * per_unit:.15g}")


def _describe_scan(lidar: LidarFile, pose: SensorPose) -> dict[str, Any]:
    instrument = lidar.instrument
    return {
        "title": lidar.title,
        "pattern": instrument.pattern.kind,
        "rows": instrument.pattern.rows,
        "columns": instrument.pattern.columns,
        "period_s": instrument.pattern.period_s,
        "rays": instrument.sub_rays,
        "wavelength_nm": _convert_unit(instrument.wavelength_m, 1e9),
        "pulse_uj": _convert_unit(instrument.pulse_j, 1e6),
        "pulse_ns": _convert_unit(instrument.pulse_fwhm_s, 1e9),
        "reported": instrument.reported,
        "sensor_to_world": pose.matrix.tolist(),
        "position_m": pose.position_m.tolist(),
        "quaternion_wxyz": quaternion(pose.rotation).tolist(),
        "axes": "x forward, y left, z up; the world has x east, y north, z up",
    }


def main(arguments: list[str]) -> int:
    """Run the job in a file, and end the process. Arguments: the job's file, the folder to write to, the scanner's
    file and the request."""
    job, folder, lidar = (Path(word) for word in arguments[:3])
    run_to_exit(
        lambda: run_job(read_job(job), folder, read_lidar(lidar), ScanRequest.from_json(arguments[3])),
        lambda: _NO_MEMORY_MESSAGE,
    )
