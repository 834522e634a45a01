"""Reads the design of a study of sensor suites from a TOML file, and checks it.

``[design]`` states facts that all suites share, ``[costs]`` the powers and rates from which energy and time follow,
``[settings]`` the camera, its sensor and the workspace. Each ``[[suite]]`` has a name, a method, perhaps several Suns,
and the settings that it changes. ``[lamp]`` states the place of a lamp. The shipped file is ``suites.toml``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...physics.light.directions import camera_axes
from ...settings.description import check, defaults, merged
from ...settings.preset_files import load_preset
from ...settings.toml_text import read_toml_and_text
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.file_schemas import FILE_NAME, NUMBER, POSITIVE, TABLE, TEXT, WHOLE, Each, Maybe, check_record
from ...support.suggestions import suggest_nearest
from ..learning.grounds import SUN_DEG, TERRAINS, Variety
from ..matchers.lidar_options import RETURNS
from ..matchers.methods import Method, parse_methods
from ..matchers.search_range import refuse_true_range
from .lamps import LAMP_SHAPE, LampPlace, SuiteLamp, read_lamp, read_place

_FIX = "compare it with the shipped design, stereo/design/suites.toml"
#: Settings that act on ray-traced pairs; others would be ignored. None stands for all settings of a topic.
_ACTING: Mapping[str, tuple[str, ...] | None] = {
    "rig": (
        "baseline_m",
        "focal_length_mm",
        "sensor_width_mm",
        "width_px",
        "height_px",
        "height_m",
        "pitch_deg",
        "heading_deg",
    ),
    "sensor": None,
    "workspace": ("cell_m", "size_m", "east_m", "north_m"),
}
#: Topics of settings that a suite may change. All suites decide on one workspace.
_CHANGED = ("rig", "sensor")
_OWN_KEYS = ("name", "method", "suns", "lamp_w")
#: Images are rendered in squares of this side, px.
_SQUARE_PX = 8
#: Least share of the workspace that both cameras must see on level ground, and the tested points along its side.
_MIN_SEEN, _LOOKED_UP = 0.5, 24
#: Most images of a decision.
MAX_SUNS = 100


@dataclass(frozen=True)
class Costs:
    """The basis of energy and processor time: powers in W, rates in 1/s, times in s, see ``suites.toml``."""

    camera_w: float
    readout_px_s: float
    processor_w: float
    processor_slowdown: float
    lidar_w: float
    lidar_points_s: float
    lidar_ready_s: float


@dataclass(frozen=True, eq=False)
class Suite:
    """A suite of sensors.

    It has complete ``settings``, a method, the number of images under different Suns, and perhaps a lamp that lights
    one more image at night.
    """

    name: str
    method: Method
    suns: int
    settings: Settings
    lamp: SuiteLamp | None = None


@dataclass(frozen=True)
class Design:
    """The content of a design's file. ``sources`` are the sources of its numbers by name."""

    path: Path
    text: str
    title: str
    variety: Variety
    rays_per_pixel: int
    abstain_loss: float
    costs: Costs
    lamp: LampPlace | None
    suites: tuple[Suite, ...]
    sources: Mapping[str, str]


_SHAPE = {
    "design": {
        "title": TEXT,
        "include": Each(TEXT),
        "terrains": Each(TEXT),
        "suns_deg": Each(NUMBER),
        "rays_per_pixel": WHOLE,
        "abstain_loss": NUMBER,
    },
    "costs": {field.name: POSITIVE for field in fields(Costs)} | {"lidar_ready_s": NUMBER},
    "lamp": Maybe(LAMP_SHAPE),
    "settings": Maybe(TABLE),
    "suite": Each({"name": FILE_NAME, "method": TEXT, "suns": Maybe(WHOLE), "lamp_w": Maybe(NUMBER)}),
    "sources": Maybe(Each(TEXT, TEXT)),
}


def list_design_names() -> list[str]:
    """List the names of the shipped designs."""
    return sorted(path.stem for path in Path(__file__).parent.glob("*.toml"))


def find_design(name: str) -> Path:
    """Return the file of a shipped design by its name, or a user's file if the name ends in .toml.

    Raises IcyMoonError if there is no design of this name.
    """
    if name.endswith(".toml"):
        return Path(name)
    if name not in list_design_names():
        raise IcyMoonError(
            f"There is no design {name!r}, {suggest_nearest(name, list_design_names())} A file of your own ends in "
            ".toml."
        )
    return Path(__file__).parent / f"{name}.toml"


def read_design(path: Path) -> Design:
    """Read and check a design. Raises IcyMoonError with the file, the fault and the remedy."""
    data, text = read_toml_and_text(path)
    _refuse_unknown_keys(data, _SHAPE, "", path)  # before missing keys, one of which may be misspelt
    for table, shape in (("design", _SHAPE["design"]), ("costs", _SHAPE["costs"]), ("lamp", LAMP_SHAPE)):
        _refuse_unknown_keys(data.get(table), shape, f"{table}.", path)
    check_record(data, _SHAPE, path, _FIX)
    head = data["design"]
    _check_head(head, data["costs"], path)
    base = merged(*_load_presets(head["include"], path), check(data.get("settings", {}), str(path)))
    _refuse_idle_settings(base, "the design", path)
    lamp = read_place(data["lamp"], path) if "lamp" in data else None
    return Design(
        path,
        text,
        head["title"],
        Variety(tuple(head["terrains"]), suns_deg=(float(head["suns_deg"][0]), float(head["suns_deg"][1]))),
        head["rays_per_pixel"],
        float(head["abstain_loss"]),
        Costs(**{key: float(value) for key, value in data["costs"].items()}),
        lamp,
        _read_suites(data["suite"], base, lamp, path),
        data.get("sources", {}),
    )


def _load_presets(names: Sequence[str], path: Path) -> list[Settings]:
    try:
        return [load_preset(name) for name in names]
    except IcyMoonError as error:
        raise IcyMoonError(f"{path}: design.include: {error}") from None


def _refuse_unknown_keys(table: object, shape: Any, name: str, path: Path) -> None:
    for key in table if isinstance(table, Mapping) else ():
        if key not in shape:
            raise IcyMoonError(f"{path}: unknown key {name}{key}, {suggest_nearest(key, tuple(shape))}")


def _check_head(head: Mapping[str, Any], costs: Mapping[str, float], path: Path) -> None:
    """Raise IcyMoonError if the terrains, Suns, rays, loss or costs are impossible in a study."""
    for name in head["terrains"]:
        if name not in TERRAINS:
            raise IcyMoonError(f"{path}: design.terrains: there is no {name!r}, {suggest_nearest(name, TERRAINS)}")
    suns, (least, most) = head["suns_deg"], SUN_DEG
    faults = {
        "design.terrains names no terrain; name one or more": not head["terrains"],
        f"design.suns_deg is {suns}; give the least and the greatest elevation, from {least:g} to {most:g}": (
            len(suns) != 2 or not least <= suns[0] < suns[1] <= most
        ),
        f"design.rays_per_pixel is {head['rays_per_pixel']}; give 1 to 64": not 1 <= head["rays_per_pixel"] <= 64,
        f"design.abstain_loss is {head['abstain_loss']:g}; give a number from 0 to 1": not 0
        <= head["abstain_loss"]
        <= 1,
        f"costs.lidar_ready_s is {costs['lidar_ready_s']:g}; give 0 or more": costs["lidar_ready_s"] < 0,
    }
    for fault, is_there in faults.items():
        if is_there:
            raise IcyMoonError(f"{path}: {fault}.")


def _refuse_idle_settings(settings: Settings, whose: str, path: Path) -> None:
    """Raise IcyMoonError if a setting does not act on ray-traced pairs."""
    for topic, values in settings.items():
        for key in values:
            acting = _ACTING.get(topic, ())
            if acting is not None and key not in acting:
                raise IcyMoonError(
                    f"{path}: {topic}.{key} of {whose} does not act on ray-traced grounds, where only sensor, "
                    "workspace and a rig of parallel cameras without margins act; leave it out."
                )


def _read_suites(
    tables: Sequence[Mapping[str, Any]], base: Settings, lamp: LampPlace | None, path: Path
) -> tuple[Suite, ...]:
    if not tables:
        raise IcyMoonError(f"{path} has no suite; add a table [[suite]] with a name and a method.")
    suites = tuple(_read_suite(table, base, lamp, path) for table in tables)
    names = [suite.name for suite in suites]
    for name in names:
        if names.count(name) > 1:
            raise IcyMoonError(f"{path} has {names.count(name)} suites {name!r}; give each suite a name of its own.")
    return suites


def _read_suite(table: Mapping[str, Any], base: Settings, lamp: LampPlace | None, path: Path) -> Suite:
    """Read a suite.

    Raises IcyMoonError if its settings, method, Suns or lamp are wrong, or if its cameras see too little.
    """
    name, where = table["name"], f"{path}: suite {table['name']}"
    changes = {key: value for key, value in table.items() if key not in _OWN_KEYS}
    for key in changes:
        if key not in _CHANGED:
            raise IcyMoonError(
                f"{where} states {key}, and a suite has {', '.join(_OWN_KEYS)}, and settings of "
                f"{' and '.join(_CHANGED)}; state what all suites share in [settings]."
            )
    own = check(changes, where)
    _refuse_idle_settings(own, f"suite {name}", path)
    suns = table.get("suns", 1)
    if not 1 <= suns <= MAX_SUNS:
        raise IcyMoonError(f"{where} has suns = {suns}; give 1 to {MAX_SUNS}, the number of its pairs in sunlight.")
    settings = merged(defaults(), base, own)
    _check_camera(settings, where)
    method = _read_method(table["method"], where)
    return Suite(name, method, suns, settings, read_lamp(table.get("lamp_w"), lamp, settings, where))


def _read_method(text: str, where: str) -> Method:
    try:
        methods = parse_methods(text)
    except IcyMoonError as error:
        raise IcyMoonError(f"{where}: method: {error}") from None
    if len(methods) > 1:
        raise IcyMoonError(f"{where} has {len(methods)} methods, {text}; give one, and each other a suite of its own.")
    if methods[0].lidar is not None and methods[0].lidar[RETURNS]:
        raise IcyMoonError(
            f"{where}: {RETURNS} is a scan of a rendered pair, but grounds by rays have none; leave it out."
        )
    refuse_true_range(methods[0].options, f"{where}: method {text}")
    return methods[0]


def _check_camera(settings: Settings, where: str) -> None:
    """Raise IcyMoonError if rays cannot render images of this size, or the cameras see no workspace or too little of
    it.
    """
    rig = settings.rig
    if not settings.workspace.cell_m > 0:
        raise IcyMoonError(f"{where} has no workspace; state workspace.cell_m in [settings], as in 0.02.")
    if rig.width_px % _SQUARE_PX or rig.height_px % _SQUARE_PX:
        raise IcyMoonError(
            f"{where} has images of {rig.width_px} x {rig.height_px} px; give multiples of {_SQUARE_PX} for "
            "rig.width_px and rig.height_px."
        )
    seen = measure_seen_share(settings)
    if seen < _MIN_SEEN:
        raise IcyMoonError(
            f"{where}: both cameras see {100 * seen:.0f} % of the workspace on level ground, and "
            f"{100 * _MIN_SEEN:.0f} % are needed; aim them by rig.pitch_deg and rig.heading_deg, shorten "
            "rig.focal_length_mm or rig.baseline_m, or move the workspace."
        )


def measure_seen_share(settings: Settings) -> float:
    """Measure the share of the workspace, on level ground under a lander, that lies in both images."""
    asked, rig, camera = settings.workspace, settings.rig, StereoCamera.from_settings(settings.rig)
    across = ((np.arange(_LOOKED_UP) + 0.5) / _LOOKED_UP - 0.5) * asked.size_m
    east, north = (each.ravel() for each in np.meshgrid(asked.east_m + across, asked.north_m + across))
    axes = camera_axes(rig.heading_deg, rig.pitch_deg)
    own = np.stack([east, north, np.full(east.size, -rig.height_m)], axis=1) @ axes
    inside = own[:, 2] > 0
    for aside in (0.0, camera.baseline_m):
        with np.errstate(divide="ignore", invalid="ignore"):
            column = camera.focal_px * (own[:, 0] - aside) / own[:, 2] + camera.cx_px
            row = camera.focal_px * own[:, 1] / own[:, 2] + camera.cy_px
        inside &= (column >= 0) & (column <= camera.width_px) & (row >= 0) & (row <= camera.height_px)
    return float(inside.mean())
