"""The verb ``projector``: a pair in the light of a pattern projector, or columns and depth from its coded light."""

from __future__ import annotations

import argparse
import math
from typing import Any

from ..physics.camera.stereo_camera import StereoCamera
from ..physics.projector.device import Projector
from ..physics.projector.ice_contrast import find_modulation, find_phase_bias
from ..physics.projector.patterns import PATTERNS, Pattern
from ..render.pairs.pair_folder import read_pair
from ..render.plans.planned_pair import expand_headings
from ..settings import user_files
from ..settings.description import check, merged
from ..settings.topics.scene import Settings
from ..stereo.export.ground import build_geometry
from ..support.errors import IcyMoonError
from ..support.files import write_json
from ..support.printer import say
from ..support.temporary_folders import open_scratch_folder
from ..support.terminal import as_path
from .render_scenes import render_settings
from .renderer_options import add_blender_option
from .scene_options import add_scene_options, read_settings

#: Absorption per transport length, for the contrast on ice that is printed.
_ICE_ABSORPTION = 0.01


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``projector``."""
    add_scene_options(parser)
    _add_pattern_options(parser)
    _add_device_options(parser)
    parser.add_argument(
        "--transport-mm", type=float, help="transport length of ice, to print the contrast that stripes keep on it"
    )
    add_blender_option(parser)
    parser.set_defaults(run=_run_projector)


def _add_pattern_options(parser: argparse.ArgumentParser) -> None:
    shown = Pattern()
    parser.add_argument(
        "--out", type=as_path, required=True, help="folder for the data sets white, direct and projected, and for code"
    )
    parser.add_argument(
        "--pattern",
        choices=[name.lower() for name in PATTERNS],
        default="dots",
        help="what is projected: dots, stripes, or a sequence of Gray code and phase (%(default)s)",
    )
    parser.add_argument("--dots", type=int, default=shown.dots, help="number of dots (%(default)s)")
    parser.add_argument("--dot-px", type=float, default=shown.dot_px, help="diameter of a dot (%(default)s)")
    parser.add_argument("--period-px", type=float, default=shown.period_px, help="period of stripes (%(default)s)")
    parser.add_argument("--shifts", type=int, default=shown.shifts, help="shifts of the phase (%(default)s)")
    parser.add_argument("--seed", type=int, default=shown.seed, help="seed of the places of dots (%(default)s)")


def _add_device_options(parser: argparse.ArgumentParser) -> None:
    own = Projector()
    parser.add_argument(
        "--pixels",
        type=int,
        nargs=2,
        metavar=("COLUMNS", "ROWS"),
        default=(own.columns, own.rows),
        help="pixels of the projector (640 480)",
    )
    parser.add_argument("--width-deg", type=float, help="width of its field (as the left camera's)")
    parser.add_argument(
        "--power", type=float, default=own.power_w, help="watts of light with all pixels on (%(default)s)"
    )
    parser.add_argument(
        "--place",
        type=float,
        nargs=3,
        metavar=("RIGHT", "AHEAD", "UP"),
        default=(own.right_m, own.ahead_m, own.up_m),
        help="metres from the left camera (0.125 0 0)",
    )
    parser.add_argument(
        "--aim",
        type=float,
        nargs=2,
        metavar=("AZIMUTH", "ELEVATION"),
        default=(own.azimuth_deg, own.elevation_deg),
        help="degrees from straight ahead, clockwise and up (0 0)",
    )


def _run_projector(options: argparse.Namespace) -> int:
    settings = read_settings(options)
    projector = make_projector(options, settings)
    pattern = Pattern(
        options.pattern.upper(), options.dots, options.dot_px, options.period_px, options.shifts, options.seed
    )
    pattern.make(projector)
    _check_transport(options.transport_mm, pattern)
    from ..stereo import projected_pairs as projected

    settings = add_projector(settings, projector)
    if refusal := projected.find_refusal(settings):
        raise IcyMoonError(refusal)
    out = options.out.absolute()
    found = _project(settings, projector, pattern, options.blender)
    (folder,) = render_settings(settings, out / "white", options.blender)
    white, direct = read_pair(folder), None
    if settings.quality.diffuse_bounces > 0:
        (folder,) = render_settings(_leave_bounces_out(settings), out / "direct", options.blender)
        direct = read_pair(folder)
    light = projected.WhiteLight.read(white, direct)
    facts = projected.describe_projector(projector, pattern, found.pose)
    if pattern.kind != "GRAY_PHASE":
        say(str(projected.save_projected_pair(white, light, found, facts, out / "projected")))
        return 0
    images, bits = projected.develop_patterns(white, light, found, settings)
    decoded = projected.decode_pair(white, images, bits, found, projector, pattern)
    folder = out / "code" / white.id
    projected.write_code(folder, images, decoded)
    summary: dict[str, Any] = {eye: each.summarise() for eye, each in decoded.items()}
    write_json(folder / "projector.json", {**facts, "errors": summary})
    for eye, errors in summary.items():
        say(
            f"{folder}: {eye}: {100 * errors['decoded_share']:.1f} % of the lit pixels decoded, median error "
            f"{errors['column_median_px']:.3f} px of the projector, {100 * errors['depth_median_share']:.2f} % of depth"
        )
    if options.transport_mm is not None:
        _tell_ice(options.transport_mm, decoded["left"].true_depth_m, projector, pattern)
    return 0


def _check_transport(transport_mm: float | None, pattern: Pattern) -> None:
    """Raise IcyMoonError for a transport length that ice cannot have, or that no result would use."""
    if transport_mm is None:
        return
    if not 0 < transport_mm < math.inf:
        raise IcyMoonError(f"--transport-mm is {transport_mm:g}; give more than 0.")
    if pattern.kind != "GRAY_PHASE":
        raise IcyMoonError("--transport-mm describes decoded stripes; add --pattern gray_phase, or leave it out.")


def make_projector(options: argparse.Namespace, settings: Settings) -> Projector:
    """Make the projector of the options. Its field is by default as wide as the left camera's."""
    camera = StereoCamera.from_settings(settings.rig)
    seen_deg = 2 * math.degrees(math.atan(camera.width_px / 2 / camera.focal_px))
    columns, rows = options.pixels
    right, ahead, up = options.place
    azimuth, elevation = options.aim
    return Projector(
        columns,
        rows,
        seen_deg if options.width_deg is None else options.width_deg,
        options.power,
        right,
        ahead,
        up,
        azimuth,
        elevation,
    )


def add_projector(settings: Settings, projector: Projector) -> Settings:
    """Return the settings with one more lamp, the last, which lights the whole cone around the projector's field."""
    lamp = {
        "kind": "SPOT",
        "power_w": projector.cone_power_w,
        "efficiency": 1.0,
        "size_m": 1e-3,
        "cone_deg": projector.cone_deg,
        "blend": 0.0,
        "place": "CAMERA",
        "x_m": projector.right_m,
        "y_m": projector.ahead_m,
        "z_m": projector.up_m,
        "azimuth_deg": projector.azimuth_deg,
        "elevation_deg": projector.elevation_deg,
    }
    light: dict[str, Any] = {"lamps": [*map(dict, settings.light.lamps), lamp]}
    if settings.light.lamp_scales:
        light["lamp_scales"] = f"{settings.light.lamp_scales}, 1"
    return merged(settings, check({"light": light}, "the projector"))


def _leave_bounces_out(settings: Settings) -> Settings:
    """Return the settings for the projector's direct light."""
    return merged(settings, {"quality": {"diffuse_bounces": 0}})


def _project(settings: Settings, projector: Projector, pattern: Pattern, blender: str) -> Any:
    from ..stereo.projected_pairs import read_projection

    planned = expand_headings(settings, user_files.hash_content(settings))
    with open_scratch_folder() as scratch:
        file = scratch / "projector.json"
        write_json(file, {"projector": vars(projector), "pattern": vars(pattern), "samples": 4})
        try:
            build_geometry(planned, scratch, blender, lambda message: None, str(file), program="project")
        except IcyMoonError as error:
            raise IcyMoonError(name_projector(str(error), len(settings.light.lamps) - 1)) from None
        return read_projection(scratch / planned[0].id / "projected.npz")


def name_projector(reason: str, number: int) -> str:
    """Rewrite a reason against a scene, so that it calls the lamp with this ``number`` in the list the projector."""
    start, end = f"light.lamps[{number}] is ", ", so it lights nothing; "
    if not reason.startswith(start) or end not in reason:
        return reason
    where = reason.removeprefix(start).partition(end)[0]
    return f"The projector is {where}, so it lights nothing; move it by --place."


def _tell_ice(transport_mm: float, depth_m: Any, projector: Projector, pattern: Pattern) -> None:
    import numpy as np

    period_mm = float(np.nanmedian(depth_m)) * 1e3 * pattern.period_px / projector.focal_px
    kept = float(find_modulation(period_mm / transport_mm, _ICE_ABSORPTION))
    say(
        f"ice of transport length {transport_mm:g} mm: stripes of {period_mm:.0f} mm keep {100 * kept:.0f} % of their "
        f"contrast, and move by {transport_mm * float(find_phase_bias(45.0)):.1f} mm at an incidence of 45°"
    )
