"""A small data set in the layout of POLAR's, made from a scene that is known: eggs in level sand, one lamp, one rig.

Eggs are convex, and the outlines of what is visible of them, and of their shadows, are convex hulls.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from icymoon.support.arrays import Array
from icymoon.validation.polar.camera import Calibration, Eye, make_camera_rotation
from icymoon.validation.polar.data_set import (
    EYES,
    HEIGHT_PX,
    ROCK,
    SHADOW,
    SURVEYED_EYES,
    SURVEYED_LAMPS,
    SURVEYED_YAW_DEG,
    WIDTH_PX,
    Rock,
    Terrain,
    View,
    read_terrains,
)
from icymoon.validation.polar.sand import Sand

SAND_M = 0.17
#: East, north, radius and height of the eggs in metres.
EGGS = (
    (-0.9, -0.6, 0.12, 0.20),
    (-0.8, 0.7, 0.14, 0.16),
    (-0.3, 0.1, 0.10, 0.22),
    (0.1, -0.8, 0.11, 0.14),
    (0.3, 0.9, 0.13, 0.18),
    (0.6, -0.2, 0.12, 0.20),
    (0.9, 0.5, 0.10, 0.13),
    (1.0, -0.9, 0.12, 0.17),
    (-0.2, -0.5, 0.07, 0.09),
    (0.5, 0.4, 0.08, 0.10),
)
FOCAL_PX, BASELINE_M = 2040.0, 0.304
#: What the camera is off the survey: yaw, pitch and roll in degrees, and its place in metres.
OFF = (-1.7, 27.0, -0.8, 0.03, -0.19, 0.35)


@dataclass(frozen=True)
class Known:
    """The truth of a folder: the eyes, and the lamp at 30 degrees."""

    eyes: dict[View, Eye]
    lamp: Array


def egg(east: float, north: float, radius: float, height: float, rows: int = 24, columns: int = 48) -> Rock:
    """The part of an egg above the sand, open below; it is widest at a third of its height."""
    polar = np.linspace(0.0, np.arccos(-0.5), rows)  # of an ellipsoid whose middle is a third of the height up
    around = 2 * np.pi * np.arange(columns) / columns
    x = east + radius * np.outer(np.sin(polar), np.cos(around))
    y = north + radius * np.outer(np.sin(polar), np.sin(around))
    z = SAND_M + height * (1 / 3 + 2 / 3 * np.cos(polar))
    vertices = np.stack([x, y, np.repeat(z[:, None], columns, axis=1)], axis=-1).reshape(-1, 3)
    row, column = (each.ravel() for each in np.mgrid[: rows - 1, :columns])
    a, b = row * columns + column, row * columns + (column + 1) % columns
    faces = np.concatenate([np.stack([a, a + columns, b], axis=1), np.stack([b, a + columns, b + columns], axis=1)])
    return Rock(0, vertices, faces)


def known(position: str = "A") -> Known:
    """The scene."""
    turn = make_camera_rotation(SURVEYED_YAW_DEG[position] + OFF[0], OFF[1], OFF[2])
    place = np.array(SURVEYED_EYES[position][0]) + OFF[3:]
    centre = np.array([WIDTH_PX, HEIGHT_PX]) / 2
    eyes = {
        View(position, eye): Eye(FOCAL_PX, centre, 0.0, 0.0, turn, place + k * BASELINE_M * turn[0])
        for k, eye in enumerate(EYES)
    }
    return Known(eyes, np.add(SURVEYED_LAMPS[30], (0.0, 0.0, SAND_M)))


def shadow_on_sand(points: Array, lamp: Array) -> Array:
    """Where the rays from the lamp through points (n, 3) meet level sand."""
    times = (lamp[2] - SAND_M) / (lamp[2] - points[:, 2])
    return lamp + (points - lamp) * times[:, None]


def _line(kind: int, pixels: Array) -> str:
    hull = cv2.convexHull(pixels.astype(np.float32))[:, 0].astype(np.float64) / [WIDTH_PX, HEIGHT_PX]
    return " ".join([str(kind), *(f"{value:.7f}" for value in hull.ravel())])


def write_polar_folder(folder: Path, name: str = "07", scale: float = 1.0) -> Known:
    """Write ``rocks/`` and ``labels/`` of a terrain, its meshes in ``scale`` units for each metre."""
    truth = known()
    for each in ("rocks", "labels"):
        (folder / each).mkdir(parents=True, exist_ok=True)
    rocks = [egg(*each) for each in EGGS]
    for number, rock in enumerate(rocks, 1):
        lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in rock.vertices * scale]
        lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in rock.faces + 1]
        (folder / "rocks" / f"terrain{name}_rock{number}.obj").write_text("\n".join(lines), encoding="utf-8")
    for view, eye in truth.eyes.items():
        lines = []
        for rock in rocks:
            cast = shadow_on_sand(rock.vertices, truth.lamp)  # the rim is its own shadow
            lines += [_line(ROCK, eye.project(rock.vertices)), _line(SHADOW, eye.project(cast))]
        (folder / "labels" / f"{name}_{view.position}_off_30_{view.eye}.txt").write_text(
            "\n".join(lines), encoding="utf-8"
        )
    return truth


def read_known(folder: Path) -> tuple[Terrain, Calibration, Sand, dict[int, Array]]:
    """Write the terrain to a folder and read it: the terrain, and its true camera, sand and lamps."""
    truth = write_polar_folder(folder)
    (terrain,) = read_terrains(folder)
    middles = np.array([rock.vertices[:, :2].mean(axis=0) for rock in terrain.rocks])
    sand = Sand(np.array([SAND_M, 0.0, 0.0]), middles, np.zeros(len(middles)), np.zeros((1, 2)), np.zeros(1))
    return terrain, Calibration(truth.eyes, np.zeros(1)), sand, {30: truth.lamp}
