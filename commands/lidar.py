"""The verb ``lidar``: a scan of the described scene by a laser scanner, without a render."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..physics.lidar.digitiser import SAMPLE_COUNTS
from ..physics.lidar.instrument import make_pose
from ..physics.lidar.scene_light import find_scene_media
from ..render.pairs.dataset_file_names import check_no_link
from ..render.pairs.pair_folder import read_pair
from ..render.plans.planned_pair import PlannedPair, expand_headings
from ..render.workers.lidar_request import EFFECTS, ScanRequest
from ..settings.preset_files import LIDARS, lidar_names
from ..settings.user_files import hash_content
from ..stereo.export.ground import build_geometry, refuse_edited
from ..stereo.export.lidar import check_format, discard_points, read_facts, write_scan
from ..support.errors import IcyMoonError
from ..support.files import is_file, quote
from ..support.number_text import format_count
from ..support.printer import say
from ..support.suggestions import suggest_nearest
from ..support.terminal import add_repeatable_option, as_path
from .renderer_options import add_blender_option
from .scene_options import add_scene_options, read_settings

#: Options for formats beside lidar.npz, with their names in a sentence.
_FORMATS = {"ply": "PLY", "las": "LAS", "laz": "LAZ (packed LAS)", "ros2": "a bag of ROS 2"}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``lidar``."""
    parser.add_argument(
        "pair", nargs="?", type=as_path, help="folder of a rendered pair whose ground is scanned, in place of settings"
    )
    add_scene_options(parser)
    parser.add_argument(
        "--lidar",
        default="ouster_os1",
        metavar="NAME",
        help=f"a shipped scanner: {', '.join(lidar_names())}; or a TOML file (%(default)s)",
    )
    parser.add_argument("--out", type=as_path, help="folder for the returns (of a pair: its own folder)")
    parser.add_argument(
        "--convert",
        type=as_path,
        metavar="FOLDER",
        help="scan nothing, and write the points of the scan in this folder in the formats that are given",
    )
    parser.add_argument(
        "--position", type=float, nargs=3, metavar=("X", "Y", "Z"), help="the sensor in metres east, north and up"
    )
    parser.add_argument(
        "--quaternion",
        type=float,
        nargs=4,
        metavar=("W", "X", "Y", "Z"),
        help="rotation from the sensor's axes (x forward, y left, z up) to east, north and up",
    )
    parser.add_argument("--rows", type=int, help="rows of the pattern, in place of the scanner's")
    parser.add_argument("--columns", type=int, help="columns of the pattern, in place of the scanner's")
    parser.add_argument("--rays", type=int, choices=(1, 20, 60), help="rays of a beam, in place of the scanner's")
    parser.add_argument(
        "--returns", choices=("ALL", "FIRST", "STRONGEST", "LAST"), help="returns of a beam, in place of the scanner's"
    )
    _add_sensing_options(parser)
    for kind, words in _FORMATS.items():
        parser.add_argument(f"--{kind}", action="store_true", help=f"write the points as {words} too")
    add_blender_option(parser)
    parser.set_defaults(run=_run_lidar)


def _add_sensing_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for light in ice and for the detector."""
    add_repeatable_option(
        parser, "--without", "EFFECT", f"leave an effect out: {', '.join(EFFECTS)}; may repeat", choices=EFFECTS
    )
    parser.add_argument("--grain-um", type=float, help="radius of the grains of snow, in place of the surfaces'")
    parser.add_argument("--density", type=float, help="density of snow in kg/m³, in place of the excavation's")
    parser.add_argument("--seed", type=int, help="seed of the detector's noise, in place of the scene's")
    parser.add_argument("--scan", type=int, default=0, help="number of the scan, which changes the noise (%(default)s)")
    parser.add_argument(
        "--waveforms",
        type=int,
        choices=SAMPLE_COUNTS,
        help="samples of what the detector receives, a packet for each pulse with a return, in lidar.wdp; LAS and LAZ "
        "refer to it",
    )


def find_lidar(name: str) -> Path:
    """Find the file of a shipped scanner, or the file at a path. Raises IcyMoonError for other names."""
    for candidate in (LIDARS / f"{name}.toml", Path(name).expanduser()):
        if ".." not in name and is_file(candidate):
            return candidate
    raise IcyMoonError(f"There is no laser scanner {quote(name)}, {suggest_nearest(name, lidar_names(), 0.4)}")


def _run_lidar(options: argparse.Namespace) -> int:
    kinds = [kind for kind in _FORMATS if getattr(options, kind)]
    for reason in filter(None, map(check_format, kinds)):
        raise IcyMoonError(reason)
    return _scan(options, kinds) if options.convert is None else _convert(options, kinds)


def _convert(options: argparse.Namespace, kinds: list[str]) -> int:
    """Write the points of an earlier scan in the formats ``kinds``. Raises IcyMoonError without a format, and for
    options of a new scan."""
    if not kinds:
        raise IcyMoonError(f"--convert has no format; give {' or '.join(f'--{kind}' for kind in _FORMATS)}.")
    if options.pair or options.out or options.preset or options.settings or options.overrides:
        raise IcyMoonError("--convert scans nothing; leave the pair, --out and the settings out.")
    if _make_request(options) != ScanRequest():
        raise IcyMoonError("--convert scans nothing; leave the options of a new scan out, such as --rows.")
    for kind in kinds:
        say(str(write_scan(options.convert, kind)))
    return 0


def _scan(options: argparse.Namespace, kinds: list[str]) -> int:
    file = find_lidar(options.lidar).absolute()
    request = _make_request(options)
    lidar = request.read_scanner(file)
    planned, out = _find_grounds(options)
    if "ice" not in request.without:
        wavelength_nm = lidar.instrument.wavelength_m * 1e9
        find_scene_media(planned[0].settings, wavelength_nm, request.grain_m, request.density_kg_m3)
    folders = [out / each.id for each in planned]
    for folder in folders:
        discard_points(folder, kinds)
    build_geometry(planned, out, options.blender, lambda message: None, str(file), request.to_json(), program="scan")
    for folder in folders:
        for kind in kinds:
            write_scan(folder, kind)
        _tell_scan(folder, lidar.title)
    return 0


def _tell_scan(folder: Path, title: str) -> None:
    facts = read_facts(folder)
    lost, noise = facts.get("lost_returns"), ""
    if lost is not None:
        alarms = format_count(facts.get("false_alarms") or 0, "false alarm")
        noise = f"; the detector lost {lost} of the returns and has {alarms}"
    say(
        f"{folder}: {title}, {format_count(facts['returns'], 'return')} of "
        f"{format_count(facts['beams'], 'beam')}, {facts['beams_without_return']} without a return{noise}"
    )


def _make_request(options: argparse.Namespace) -> ScanRequest:
    """Make the request for a scan. Raises IcyMoonError for a pose without a place or a rotation, and for negative
    seeds."""
    if (options.position is None) != (options.quaternion is None):
        raise IcyMoonError("A pose has a place and a rotation; give --position and --quaternion, or neither.")
    if options.position is not None:
        make_pose(options.position, options.quaternion)
    for name, least in (("seed", 0), ("scan", 0)):
        value = getattr(options, name)
        if value is not None and value < least:
            raise IcyMoonError(f"--{name} is {value}; give {least} or more.")
    return ScanRequest(
        (*options.position, *options.quaternion) if options.position else (),
        options.rows,
        options.columns,
        options.rays,
        options.returns,
        tuple(options.without),
        None if options.grain_um is None else options.grain_um * 1e-6,
        options.density,
        options.seed,
        options.scan,
        options.waveforms,
    )


def _find_grounds(options: argparse.Namespace) -> tuple[list[PlannedPair], Path]:
    """Find the pairs whose ground is scanned: the described ones, one for each heading, or the rendered pair. A stated
    pose has one heading. Also return the parent of the folders that their ids name."""
    if options.pair is None:
        if options.out is None:
            raise IcyMoonError("The scan has no folder to go to; give --out, or the folder of a rendered pair.")
        settings = read_settings(options)
        planned = list(expand_headings(settings, hash_content(settings)))
        return planned[:1] if options.position else planned, options.out
    if options.preset or options.settings or options.overrides:
        raise IcyMoonError("A pair has its own settings; leave --preset, --settings and --set out, or the pair.")
    pair = read_pair(options.pair)
    refuse_edited(pair)
    folder = pair.folder.absolute()
    if options.out is None and options.ros2:
        raise IcyMoonError("A bag is a folder, and a pair's folder has files only; give --out for it.")
    if options.out is None and folder.name != pair.id:
        raise IcyMoonError(f"{folder} does not have the name of its pair, {pair.id}; rename it, or give --out.")
    if options.out is None:
        check_no_link(folder)
    return [PlannedPair(pair.id, pair.settings, 0.0)], options.out or folder.parent
