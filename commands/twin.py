"""The verb ``twin``: photographed pairs beside their twins, rendered with the same rig; a second run continues an
interrupted one.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..formats.calibrations.registry import read_calibration
from ..formats.map_site import check_map
from ..physics.camera.calibrated_camera import CalibratedRig
from ..physics.camera.stereo_camera import StereoCamera
from ..render.cost.blender_abilities import check_abilities
from ..render.plans.frozen_plan import freeze_plan
from ..render.workers.process import report_errors
from ..settings import description, preset_files
from ..settings.topics.scene import Settings
from ..settings.user_files import find_used_files
from ..support import printer
from ..support.terminal import as_path, show_count, show_progress
from .batch import add_worker_options, parse_workers, render_missing
from .camera import add_calibration_options, choose_cameras, read_rectified_rig, read_rig, read_stated_facts
from .scene_options import add_scene_options

if TYPE_CHECKING:
    from ..stereo.matchers.methods import Method
    from ..stereo.twin.photographs import Rectification
    from ..stereo.twin.plan import Described, Twin

#: Folders of the twins and of their measurements, in the folder of the results.
_TWINS_FOLDER, _MEASUREMENTS_FOLDER = "twins", "measured"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``twin``."""
    parser.add_argument(
        "photographs",
        type=as_path,
        nargs="+",
        metavar="IMAGE",
        help="LEFT RIGHT of a pair, or of several; or one folder with the images of both eyes",
    )
    parser.add_argument(
        "--calibration",
        type=as_path,
        nargs="+",
        required=True,
        metavar="FILE",
        help="calibration of both cameras, as icymoon camera reads it",
    )
    add_calibration_options(parser)
    parser.add_argument(
        "--rectified", action="store_true", help="the images are rectified, and the calibration is for rectified images"
    )
    parser.add_argument(
        "--depth",
        type=as_path,
        nargs="+",
        default=[],
        metavar="FILE",
        help="planar depths in metres at the pixels of the left image: PFM, npy, EXR, TIFF; one for each pair",
    )
    parser.add_argument("--ground", type=as_path, metavar="DEM", help="height map for the ground, as source.file")
    add_scene_options(parser)
    parser.add_argument("--methods", default="bm,sgbm", help="matchers, separated by commas (%(default)s)")
    parser.add_argument("--out", type=as_path, required=True, metavar="FOLDER", help="folder of the twins and the page")
    add_worker_options(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from ..stereo.environment import packages

    packages.require_modules(*packages.PACKAGES)
    from ..stereo.matchers.methods import parse_methods
    from ..stereo.twin.photographs import find_photographs, make_rectification
    from ..stereo.twin.plan import plan_twins

    out = options.out.absolute()
    with report_errors(options.json):
        methods = parse_methods(options.methods)
        pairs = find_photographs(options.photographs, options.depth)
        rig, cameras, notes = _read_cameras(options)
        described = _describe(options, rig)
        where = " and ".join(map(str, options.calibration))
        settings = described.complete()
        _check_ground(settings)
        rectification = make_rectification(cameras, StereoCamera.from_settings(settings.rig).rectified, where)
        twins = plan_twins(pairs, described, rectification)
        doubts = [doubt for each in twins for doubt in each.doubts]
        for doubt in doubts:
            printer.warn(doubt)
        status = _render(twins, rectification, methods, out, options)
        page = _measure(twins, described, rectification, methods, [*notes, *doubts], out, options)
    if options.json:
        printer.emit("result", page=str(page))
    else:
        printer.say(str(page))
    return status


def _read_cameras(options: argparse.Namespace) -> tuple[Settings, CalibratedRig, list[str]]:
    """Read the rig's settings, the two cameras that took the images, and sentences about the calibration."""
    files, stated = options.calibration, read_stated_facts(options)
    if options.rectified:
        return read_rectified_rig(*files, stated=stated, kind=options.format, names=options.cameras)
    rig, notes = read_rig(*files, stated=stated, kind=options.format, names=options.cameras)
    reading = choose_cameras(read_calibration(files, stated, options.format), options.cameras)
    return rig, reading.rig, notes


def _describe(options: argparse.Namespace, rig: Settings) -> Described:
    from ..stereo.twin.plan import Described

    presets = [preset_files.load_preset(name) for name in options.preset]
    files = [preset_files.load(path) for path in options.settings]
    changes = [description.override(text) for text in options.overrides]
    ground = []
    if options.ground:
        source = {"source": {"kind": "HEIGHT_MAP", "file": str(options.ground.absolute())}}
        ground = [description.check(source, "--ground")]
    return Described(
        description.merged(description.defaults(), *presets, *files),
        rig,
        description.merged(*ground, *changes),
        [*files, *changes],
    )


def _check_ground(settings: Settings) -> None:
    """Raise IcyMoonError if a height map cannot become the ground. Only the head of its file is read."""
    if settings.source.kind == "HEIGHT_MAP":
        check_map(find_used_files(settings)["source.file"], settings)


def _render(
    twins: list[Twin], rectification: Rectification, methods: list[Method], out: Path, options: argparse.Namespace
) -> int:
    """Render the missing twins. Returns the exit status: 1 if some were set aside, else 0."""
    from ..stereo.twin.compare_twin import check_matchers

    how, dataset = parse_workers(options), out / _TWINS_FOLDER
    planned = [twin.planned for twin in twins]
    missing = freeze_plan(dataset, planned, "").find_missing(dataset)
    if not missing:
        return 0
    # All pairs have the size of the rig, so one is enough.
    check_matchers(twins[0].photographs, rectification, twins[0].planned.settings, methods)
    check_abilities((pair.settings for pair in missing), options.blender)
    if options.json:
        return render_missing(dataset, planned, how, printer.emit)
    with show_progress("Starting Blender") as show:
        return render_missing(dataset, planned, how, lambda kind, **facts: show({"type": kind, **facts}))


def _measure(
    twins: list[Twin],
    described: Described,
    rectification: Rectification,
    methods: list[Method],
    notes: list[str],
    out: Path,
    options: argparse.Namespace,
) -> Path:
    """Measure the new pairs and write the page. Returns its path."""
    from ..render.pairs.pair_folder import is_complete
    from ..stereo.twin.compare_twin import read_or_measure
    from ..stereo.twin.limits import list_limits
    from ..stereo.twin.page import write_page
    from ..stereo.twin.summary import summarise
    from ..support.errors import IcyMoonError

    done, records = [], []
    with show_count("Measuring") as show:
        for number, twin in enumerate(twins):
            show(number, len(twins))
            folder = twin.planned.folder(out / _TWINS_FOLDER)
            if is_complete(folder):
                done.append(twin)
                records.append(
                    read_or_measure(
                        twin.photographs,
                        rectification,
                        folder,
                        twin.planned.settings,
                        methods,
                        out / _MEASUREMENTS_FOLDER,
                    )
                )
    if not done:
        raise IcyMoonError(
            f"No twin in {out / _TWINS_FOLDER} is whole; correct the faults that were reported for the pairs, and "
            "run the command again."
        )
    rows, needed = summarise(records, methods)
    ground = str(options.ground) if options.ground else ""
    limits = list_limits(done, records, described, rectification, needed, ground)
    return write_page(out, out / _MEASUREMENTS_FOLDER, done, records, rows, methods, limits, notes)
