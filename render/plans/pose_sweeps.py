"""The ``[[sweep]]`` tables of a plan that place the camera: they set the ``rig``. Imports no Blender.

The heights of ground and rocks follow from the settings alone. So a camera that would stand in the ground or in a
rock is refused before anything is built.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from ...formats.toml_lines import Place
from ...physics.light.directions import direction_toward
from ...physics.scene_checks import MIN_EYE_HEIGHT_M
from ...physics.terrain.standing_places import RockyGround
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import is_number
from ...support.files import quote
from ...support.number_text import format_count
from . import trajectory_sweeps
from .planned_pair import compute_heading_deg
from .setting_sweeps import (
    Sweep,
    Variation,
    check_keys,
    check_pair_count,
    check_settings,
    make_axis_generator,
    read_count,
)

#: Returns the ground of complete settings, or raises IcyMoonError for ground from a file.
Ground = Callable[[Settings], RockyGround]


def _read_numbers(sweep: Sweep, key: str, default: Sequence[float] | None = None) -> list[float]:
    """Read a sweep's number or list of numbers as a list."""
    value = sweep.table.get(key, None if default is None else list(default))
    place = sweep.place.at(key)
    values = value if isinstance(value, list) else [value]
    if not values or not all(map(is_number, values)):
        problem = "is missing" if value is None else f"is {quote(value)}"
        raise IcyMoonError(f"{place}: {key} {problem}, but must be a number or a list of numbers.")
    return [float(v) for v in values]


def _read_length(sweep: Sweep, key: str, default: float) -> float:
    [value, *more] = _read_numbers(sweep, key, (default,))
    if more or value < 0:
        raise IcyMoonError(f"{sweep.place.at(key)}: {key} must be one number of metres from 0 up.")
    return value


def _make_rig_variation(sweep: Sweep, **values: float) -> Variation:
    """Make a variation that sets these values of the rig, rounded to six digits."""
    rig = {key: float(f"{value:.6g}") for key, value in values.items()}
    place = Place(sweep.place.file, sweep.place.text, sweep.place.key)
    try:
        return Variation(check_settings({"rig": rig}, place), place)
    except IcyMoonError as error:
        raise IcyMoonError(f"{error} The {sweep.kind} sweep sets this value.") from None


def _make_panorama(sweep: Sweep, base: Settings, ground: Ground) -> list[Variation]:
    check_keys(sweep.table, ("headings", "pitches_deg"), sweep.place, "a panorama sweep")
    stated = sweep.table.get("headings", 4)
    if isinstance(stated, int) and not isinstance(stated, bool) and stated > 0:
        check_pair_count(stated, sweep.place.at("headings"))
        headings = [compute_heading_deg(base, k, stated) for k in range(stated)]
    elif isinstance(stated, list):
        headings = _read_numbers(sweep, "headings")
    else:
        raise IcyMoonError(
            f"{sweep.place.at('headings')}: headings is {quote(stated)}, but must be a number of headings or a list "
            "of degrees."
        )
    pitches = _read_numbers(sweep, "pitches_deg", (base.rig.pitch_deg,))
    return [
        _make_rig_variation(sweep, heading_deg=heading, pitch_deg=pitch) for pitch in pitches for heading in headings
    ]


def _make_view_sphere(sweep: Sweep, base: Settings, ground: Ground) -> list[Variation]:
    check_keys(
        sweep.table,
        ("elevations_deg", "azimuths_deg", "distances_m", "target_height_m"),
        sweep.place,
        "a view_sphere sweep",
    )
    standing, rig = ground(base), base.rig
    target = np.array([rig.x_m, rig.y_m, _read_length(sweep, "target_height_m", 0.0)])
    target[2] += float(standing.heights(*target[:2]))
    if not math.isfinite(target[2]):
        raise IcyMoonError(
            f"{sweep.place}: there is no ground at the target, east {target[0]:g} m, north "
            f"{target[1]:g} m; change rig.x_m and rig.y_m."
        )
    distances, elevations, azimuths = (
        _read_numbers(sweep, key) for key in ("distances_m", "elevations_deg", "azimuths_deg")
    )
    check_pair_count(len(distances) * len(elevations) * len(azimuths), sweep.place)
    return [_look_at(target, *view, sweep, standing) for view in itertools.product(distances, elevations, azimuths)]


def _look_at(
    target: Array, distance: float, elevation: float, azimuth: float, sweep: Sweep, standing: RockyGround
) -> Variation:
    """Make a camera that looks at a target. Raises IcyMoonError if the camera is beyond the ground, or below the
    ground."""
    x, y, z = target + distance * direction_toward(azimuth, elevation)
    x, y = (float(f"{v:.6g}") for v in (x, y))
    height = z - float(standing.heights(x, y))
    at = f"The camera at elevation {elevation:g}°, azimuth {azimuth:g}°, {distance:g} m from the target"
    if not math.isfinite(height):
        raise IcyMoonError(f"{sweep.place}: {at}, is beyond the ground; come nearer or raise terrain.size_m.")
    if height < MIN_EYE_HEIGHT_M:
        raise IcyMoonError(
            f"{sweep.place}: {at}, is {-height:.3g} m under the ground; raise "
            "target_height_m, the distance or the elevation, or take other azimuths."
        )
    heading = (azimuth + 360.0) % 360.0 - 180.0
    return _make_rig_variation(sweep, x_m=x, y_m=y, height_m=height, pitch_deg=elevation, heading_deg=heading)


def _make_sites(sweep: Sweep, base: Settings, ground: Ground) -> list[Variation]:
    check_keys(
        sweep.table, ("count", "clearance_m", "margin_m", "apart_m", "random_headings"), sweep.place, "a sites sweep"
    )
    count, turned = read_count(sweep), sweep.table.get("random_headings", False)
    if not isinstance(turned, bool):
        raise IcyMoonError(f"{sweep.place.at('random_headings')}: random_headings must be true or false.")
    clearance, margin, apart = (
        _read_length(sweep, key, default)
        for key, default in (("clearance_m", 0.25), ("margin_m", 1.0), ("apart_m", 0.0))
    )
    seed = int(base.dataset.seed)
    found = ground(base).choose_places(count, clearance, margin, apart, make_axis_generator(sweep, "place", seed))
    if len(found) < count:
        raise IcyMoonError(
            f"{sweep.place}: the {base.terrain.size_m:g} m patch has room for {len(found)} of "
            f"{format_count(count, 'site')} {clearance:g} m clear of rocks, {margin:g} m from its edge "
            f"and {apart:g} m apart; lower count, clearance_m, margin_m, apart_m or rocks.coverage."
        )
    headings = make_axis_generator(sweep, "heading", seed).uniform(-180.0, 180.0, count)
    more: list[dict[str, float]] = [{"heading_deg": h} if turned else {} for h in headings.tolist()]
    return [
        _make_rig_variation(sweep, x_m=x, y_m=y, **extra) for (x, y), extra in zip(found.tolist(), more, strict=True)
    ]


_MAKER_BY_KIND: dict[str, Callable[[Sweep, Settings, Ground], list[Variation]]] = {
    "sites": _make_sites,
    "view_sphere": _make_view_sphere,
    "panorama": _make_panorama,
    trajectory_sweeps.KIND: trajectory_sweeps.make_trajectory,
}
#: Kinds of sweeps that place the camera, in the order of their application: the site, then the view.
KINDS = tuple(_MAKER_BY_KIND)


def list_rig_settings(sweep: Sweep) -> tuple[frozenset[str], frozenset[str]]:
    """List the settings in which the cameras of a sweep of one of ``KINDS`` differ, and the settings that the sweep
    replaces. Equal rotations begin at ``rig.heading_deg``, and a view sphere is around the rig's position."""
    if sweep.kind == trajectory_sweeps.KIND:
        return trajectory_sweeps.SETTINGS, trajectory_sweeps.SETTINGS
    if sweep.kind == "panorama":
        turned, pitched = (
            {"rig.heading_deg"} if isinstance(sweep.table.get("headings"), list) else set(),
            {"rig.pitch_deg"} if "pitches_deg" in sweep.table else set(),
        )
        return frozenset({"rig.heading_deg", *pitched}), frozenset(turned | pitched)
    if sweep.kind == "view_sphere":
        keys = frozenset({"rig.height_m", "rig.pitch_deg", "rig.heading_deg"})
    else:
        keys = frozenset({"rig.x_m", "rig.y_m", *(["rig.heading_deg"] if sweep.table.get("random_headings") else [])})
    return keys, keys


def make_camera_variations(sweep: Sweep, base: Settings, ground: Ground) -> list[Variation]:
    """Make the camera settings of a sweep of one of ``KINDS`` for complete settings.

    Raises IcyMoonError that names the line at fault.
    """
    return _MAKER_BY_KIND[sweep.kind](sweep, base, ground)
