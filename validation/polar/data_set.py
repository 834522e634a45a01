"""The folder of a POLAR terrain: rocks as meshes, and photographs as polygons drawn by hand.

Source: POLAR-Sim (Chen et al., arXiv 2309.12397, CC0 1.0) on the photographs of NASA Ames' POLAR data set. A folder has
``rocks/terrainTT_rockN.obj`` in metres, +X toward Sun azimuth 0 and +Z up, and ``labels/TT_P_off_AZ_E.txt`` for camera
position P, Sun azimuth AZ and eye E, and may have the ``photographs/TT_P_off_AZ_E.png``. A line of a label is a class,
then x y pairs as shares of width and height.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ...physics.triangle_files.obj import parse_triangles
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import read
from .skirts import find_open_corners, find_skirt

WIDTH_PX, HEIGHT_PX = 1936, 1216
EYES = ("L", "R")
GROUND, ROCK, SHADOW = 1, 2, 3
DATA_ADVICE = (
    "get POLAR-Sim (github.com/uwsbel/POLAR-Sim, CC0) and put rocks/terrainTT_rockN.obj and "
    "labels/TT_P_off_AZ_E.txt of a terrain TT into it"
)
#: Positions of the eyes and the lamp in metres, and yaw of the camera in degrees, as the release's demo states them.
SURVEYED_EYES = {
    "A": ((3.541, -0.303, 1.346), (3.532, -0.002, 1.344)),
    "B": ((5.500, -0.303, 1.345), (5.500, -0.002, 1.344)),
    "C": ((0.316, -3.540, 1.346), (0.611, -3.479, 1.344)),
}
SURVEYED_YAW_DEG = {"A": 180.0, "B": 180.0, "C": 100.0}
SURVEYED_PITCH_DEG = 23.0
SURVEYED_BASELINE_M = 0.301
SURVEYED_LAMPS = {
    30: (3.594, 1.422, 0.803),
    180: (-3.544, 0.475, 0.776),
    270: (-0.271, -4.109, 0.811),
    350: (4.026, -0.896, 0.771),
}
#: Least size in metres of a rock; a smaller mesh is not in metres.
_MIN_ROCK_M = 0.01
#: Largest size in metres of a rock.
_MAX_ROCK_M = 2.0
#: Least number of rocks. Each gives a point of two coordinates to a pose of six numbers and a lens; twice as many as
#: necessary are required.
_MIN_ROCKS = 8
#: Largest distance of a hand-drawn corner outside its image, as a share of the image.
_MAX_OUTSIDE_SHARE = 0.05
#: Largest text of polygons in bytes.
_MAX_LABEL_BYTES = 10_000_000
#: Maximum number of triangles of a rock.
_MAX_TRIANGLES = 2_000_000
_LABEL = re.compile(r"(\d+)_([A-Z])_off_(\d+)_([LR])\.txt")
_IMAGE = re.compile(r"(\d+)_([A-Z])_off_(\d+)_([LR])\.png")
_ROCK = re.compile(r"terrain(\d+)_rock(\d+)\.obj")


@dataclass(frozen=True)
class Rock:
    """A scanned rock with some sand around it: vertices (n, 3) in metres, triangles (m, 3)."""

    number: int
    vertices: Array
    faces: Array

    @cached_property
    def skirt(self) -> Array:
        """Mask (m,) of the triangles that show sand."""
        return find_skirt(self.vertices, self.faces)

    @cached_property
    def rim(self) -> Array:
        """Vertices (n, 3) on the open edges; all vertices if there are no open edges."""
        corners = find_open_corners(self.faces)
        return np.asarray(self.vertices[corners] if len(corners) else self.vertices)


@dataclass(frozen=True, order=True)
class View:
    """The viewpoint of a photograph: camera position and eye."""

    position: str
    eye: str


@dataclass(frozen=True)
class Polygon:
    """An object that was outlined by hand in a photograph: its class, and its corners (n, 2) in pixels."""

    kind: int
    corners: Array


@dataclass(frozen=True)
class Terrain:
    """A terrain: its rocks, the polygons of each photograph by view and Sun azimuth in degrees, and the photographs
    themselves where the folder has them."""

    name: str
    rocks: tuple[Rock, ...]
    photographs: dict[tuple[View, int], tuple[Polygon, ...]] = field(repr=False)
    images: dict[tuple[View, int], Path] = field(default_factory=dict, repr=False)

    @property
    def views(self) -> list[View]:
        """The views that have photographs."""
        return sorted({view for view, _ in self.photographs})

    @property
    def positions(self) -> list[str]:
        """The camera positions that have photographs."""
        return sorted({view.position for view in self.views})

    @property
    def azimuths(self) -> list[int]:
        """The Sun azimuths in degrees that have photographs."""
        return sorted({azimuth for _, azimuth in self.photographs})

    def polygons(self, view: View, azimuth: int, kind: int) -> list[Array]:
        """Return the corners of the polygons of a class in a photograph; none if there is no photograph."""
        return [each.corners for each in self.photographs.get((view, azimuth), ()) if each.kind == kind]


def read_terrains(folder: Path) -> list[Terrain]:
    """Read all complete terrains of a folder.

    Raises IcyMoonError if it has no complete terrain, or if one of its files cannot be read or is invalid.
    """
    if not folder.is_dir():
        raise IcyMoonError(f"--polar: there is no folder {folder}; {DATA_ADVICE}.")
    labels, rocks = (_find_files(folder / name, pattern) for name, pattern in (("labels", _LABEL), ("rocks", _ROCK)))
    for name, found in (("labels", labels), ("rocks", rocks)):
        if not found:
            raise IcyMoonError(f"{folder / name} has no files of a terrain; {DATA_ADVICE}.")
    if lone := {found[1] for _, found in labels} ^ {found[1] for _, found in rocks}:
        raise IcyMoonError(
            f"{folder}: terrain {min(lone)} has labels or rocks, but not both; add what is missing, or "
            "remove its files."
        )
    images = _find_files(folder / "photographs", _IMAGE)
    return [
        replace(
            _read_terrain(
                name,
                [(path, found) for path, found in labels if found[1] == name],
                [(path, found) for path, found in rocks if found[1] == name],
            ),
            images={(View(found[2], found[4]), int(found[3])): path for path, found in images if found[1] == name},
        )
        for name in sorted({found[1] for _, found in labels})
    ]


def _find_files(folder: Path, pattern: re.Pattern[str]) -> list[tuple[Path, re.Match[str]]]:
    paths = sorted(folder.iterdir()) if folder.is_dir() else []
    return [(path, found) for path in paths if (found := pattern.fullmatch(path.name))]


def _read_terrain(
    name: str, labels: list[tuple[Path, re.Match[str]]], rocks: list[tuple[Path, re.Match[str]]]
) -> Terrain:
    photographs = {}
    for path, found in labels:
        view, azimuth = View(found[2], found[4]), int(found[3])
        if view.position not in SURVEYED_EYES or azimuth not in SURVEYED_LAMPS:
            raise IcyMoonError(
                f"{path}: there is no survey of camera position {view.position} with the lamp at "
                f"{azimuth}°; positions are {', '.join(SURVEYED_EYES)}, azimuths "
                f"{', '.join(map(str, SURVEYED_LAMPS))}. Remove the file."
            )
        photographs[view, azimuth] = _read_polygons(path)
    terrain = Terrain(name, tuple(read_rock(path, int(found[2])) for path, found in rocks), photographs)
    if len(rocks) < _MIN_ROCKS:
        raise IcyMoonError(
            f"{rocks[0][0].parent}: terrain {name} has {len(rocks)} rocks, too few to fit a camera to; "
            f"add at least {_MIN_ROCKS - len(rocks)} of its others."
        )
    for position in terrain.positions:
        if missing := {View(position, eye) for eye in EYES} - set(terrain.views):
            raise IcyMoonError(
                f"{labels[0][0].parent}: terrain {name} has no photograph of position {position}, eye "
                f"{min(missing).eye}; add it."
            )
    return terrain


def _read_polygons(path: Path) -> tuple[Polygon, ...]:
    return read(
        path,
        lambda foreign: _parse_polygons(path, foreign.text()),
        "a text of polygons",
        "get the file again",
        most=_MAX_LABEL_BYTES,
    )


def _parse_polygons(path: Path, content: str) -> tuple[Polygon, ...]:
    found = []
    for line, text in enumerate(content.splitlines(), 1):
        try:
            words = text.split()
            numbers = np.array(words[1:] if len(words) % 2 else words[2:], np.float64)
            kind = int(words[0])
            if len(numbers) < 6 or not np.isfinite(numbers).all() or not 0 <= kind <= SHADOW:
                raise ValueError
        except (ValueError, IndexError):
            raise IcyMoonError(
                f"{path}, line {line}: is not a polygon (a class from 0 to 3, then at least three pairs "
                "of x and y); get the file again."
            ) from None
        if numbers.min() < -_MAX_OUTSIDE_SHARE or numbers.max() > 1 + _MAX_OUTSIDE_SHARE:
            raise IcyMoonError(
                f"{path}, line {line}: has a corner at {max(numbers, key=abs):g}, which is not a share of "
                f"an image from 0 to 1; divide x and y by its {WIDTH_PX} columns and {HEIGHT_PX} rows."
            )
        found.append(Polygon(kind, numbers.reshape(-1, 2) * [WIDTH_PX, HEIGHT_PX]))
    return tuple(found)


def read_rock(path: Path, number: int) -> Rock:
    """Read a rock from an OBJ file. Raises IcyMoonError for another file, and if it is too large or too small for a
    rock.
    """
    rock = Rock(
        number,
        *read(
            path,
            lambda foreign: parse_triangles(foreign, _MAX_TRIANGLES),
            "a mesh of triangles in OBJ",
            "get the file again",
        ),
    )
    if not len(rock.faces) or not np.isfinite(rock.vertices).all():
        raise IcyMoonError(f"{path}: is not a mesh of triangles in OBJ; get the file again.")
    size = float(np.ptp(rock.vertices, axis=0).max())
    if not _MIN_ROCK_M <= size <= _MAX_ROCK_M:
        raise IcyMoonError(
            f"{path}: is {size:.3g} m wide, which no rock of the sandbox is ({_MIN_ROCK_M:g} to "
            f"{_MAX_ROCK_M:g} m); export it in metres."
        )
    return rock
