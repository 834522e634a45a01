"""The verb ``lidar``: a scan of the described scene by a laser scanner, without a render."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..formats.lidar_file import change_lidar, read_lidar
from ..physics.lidar.instrument import make_pose
from ..render.plans.planned_pair import expand_headings
from ..settings.preset_files import LIDARS, lidar_names
from ..stereo.export.ground import build_geometry
from ..support.errors import IcyMoonError
from ..support.file_schemas import COUNT, NUMBER, read_record
from ..support.files import is_file, quote
from ..support.number_text import format_count
from ..support.printer import say
from ..support.suggestions import suggest_nearest
from ..support.terminal import as_path
from .renderer_options import add_blender_option
from .scene_options import add_scene_options, read_settings


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``lidar``."""
    add_scene_options(parser)
    parser.add_argument(
        "--lidar",
        default="ouster_os1",
        metavar="NAME",
        help=f"a shipped scanner: {', '.join(lidar_names())}; or a TOML file (%(default)s)",
    )
    parser.add_argument("--out", type=as_path, required=True, help="folder for the returns")
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
    parser.add_argument("--ply", action="store_true", help="write the points as PLY too")
    add_blender_option(parser)
    parser.set_defaults(run=_run_lidar)


def find_lidar(name: str) -> Path:
    """The file of a shipped scanner, or the file at a path. Raises IcyMoonError for other names."""
    for candidate in (LIDARS / f"{name}.toml", Path(name).expanduser()):
        if ".." not in name and is_file(candidate):
            return candidate
    raise IcyMoonError(f"There is no laser scanner {quote(name)}, {suggest_nearest(name, lidar_names(), 0.4)}")


def _run_lidar(options: argparse.Namespace) -> int:
    file = find_lidar(options.lidar).absolute()
    lidar = change_lidar(read_lidar(file), options.rows, options.columns, options.rays, options.returns)
    if (options.position is None) != (options.quaternion is None):
        raise IcyMoonError("A pose has a place and a rotation; give --position and --quaternion, or neither.")
    if options.position is not None:
        make_pose(options.position, options.quaternion)
    pose = ",".join(map(repr, [*options.position, *options.quaternion])) if options.position else ""
    texts = ["" if each is None else str(each) for each in (options.rows, options.columns, options.rays)]
    planned = expand_headings(read_settings(options))[:1]
    build_geometry(
        planned,
        options.out,
        options.blender,
        lambda message: None,
        str(file),
        pose,
        *texts,
        options.returns or "",
        "1" if options.ply else "0",
        program="scan",
    )
    folder = options.out / planned[0].id
    shape = {"returns": COUNT, "beams": COUNT, "beams_without_return": COUNT, "wavelength_nm": NUMBER}
    facts = read_record(folder / "lidar.json", shape, "scan the scene again")
    say(
        f"{folder}: {lidar.title}, {format_count(facts['returns'], 'return')} of "
        f"{format_count(facts['beams'], 'beam')}, {facts['beams_without_return']} without a return"
    )
    return 0
