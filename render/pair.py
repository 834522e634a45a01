"""The pair folder: the contract between rendering and everything that measures.

``<dataset>/pairs/<id>/`` holds ``left.exr``, ``right.exr`` and ``pair.json``. A pair is written as
``<id>.part`` and renamed when ``pair.json`` is in it, so a folder without the suffix that has a
``pair.json`` is complete. Images are linear radiance in W/(m² sr) per band; truth is sampled at
pixel centres and never antialiased. Imports no Blender.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..changes import response
from ..errors import IcyMoonError
from ..files import PART, disk_errors, sha256, write_json
from ..settings import Settings, merged

FORMAT = "icymoon-pair"
VERSION = 1
EYES = ("left", "right")


@dataclass(frozen=True)
class StereoCamera:
    """Two identical, parallel pinhole cameras, the right one ``baseline_m`` along the left one's x.

    The principal point is in pixel-corner coordinates: pixel (column u, row v) has its centre at
    (u + 0.5, v + 0.5), so a ray through it is ((u + 0.5 - cx) / f, (v + 0.5 - cy) / f, 1).
    """

    width_px: int
    height_px: int
    focal_px: float
    cx_px: float
    cy_px: float
    baseline_m: float

    @classmethod
    def from_settings(cls, rig: dict[str, Any]) -> StereoCamera:
        """From the ``rig`` settings; the sensor width spans the image width, pixels are square."""
        focal = rig["focal_length_mm"] / rig["sensor_width_mm"] * rig["width_px"]
        return cls(rig["width_px"], rig["height_px"], focal, rig["width_px"] / 2 + rig["principal_x_px"],
                   rig["height_px"] / 2 + rig["principal_y_px"], rig["baseline_m"])

    @property
    def focal_baseline_px_m(self) -> float:
        """f·B in px·m: disparity (px) times planar depth (m)."""
        return self.focal_px * self.baseline_m

    @property
    def matrix(self) -> list[list[float]]:
        """The 3x3 calibration matrix K, pixel-corner coordinates."""
        return [[self.focal_px, 0.0, self.cx_px], [0.0, self.focal_px, self.cy_px], [0.0, 0.0, 1.0]]

    @property
    def field_of_view_deg(self) -> tuple[float, float]:
        """Horizontal and vertical field of view in degrees."""
        return (math.degrees(2 * math.atan(self.width_px / 2 / self.focal_px)),
                math.degrees(2 * math.atan(self.height_px / 2 / self.focal_px)))

    def disparity(self, depth_m: np.ndarray) -> np.ndarray:
        """Disparity in px of planar depths in metres; NaN stays NaN (sky)."""
        return self.focal_baseline_px_m / np.asarray(depth_m, np.float64)

    def to_json(self) -> dict[str, Any]:
        """The ``camera`` table of ``pair.json``."""
        return {"width_px": self.width_px, "height_px": self.height_px, "focal_px": self.focal_px,
                "cx_px": self.cx_px, "cy_px": self.cy_px, "baseline_m": self.baseline_m,
                "K": self.matrix, "focal_baseline_px_m": self.focal_baseline_px_m,
                "pixel_centre": "(u + 0.5, v + 0.5)"}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> StereoCamera:
        """Back from the ``camera`` table of ``pair.json``."""
        return cls(*(data[key] for key in ("width_px", "height_px", "focal_px", "cx_px", "cy_px", "baseline_m")))


@dataclass(frozen=True)
class Pair:
    """A complete pair on disk."""

    folder: Path
    id: str
    settings: Settings
    camera: StereoCamera
    data: dict[str, Any]  # the whole of pair.json

    def image(self, eye: str) -> Path:
        """Path of ``left.exr`` or ``right.exr``."""
        return self.folder / f"{eye}.exr"


def read_pair(folder: Path) -> Pair:
    """Read ``pair.json`` of one pair. Raises IcyMoonError if it is missing, foreign or incomplete."""
    path = folder / "pair.json"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise IcyMoonError(f"{folder} is not a complete stereo pair (no pair.json); render it again.") from None
    except (OSError, ValueError) as error:
        raise IcyMoonError(f"{path} cannot be read ({error}); delete the folder and render the pair again.") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise IcyMoonError(f"{path} is not an Icy Moon pair; choose a folder that Render Stereo Pair wrote.")
    if data.get("version") != VERSION:
        raise IcyMoonError(f"{path} has format version {data.get('version')}, this Icy Moon reads {VERSION}; "
                           "use the version that wrote it.")
    try:
        pair = Pair(folder, data["id"], data["settings"], StereoCamera.from_json(data["camera"]), data)
    except KeyError as error:
        raise IcyMoonError(f"{path} lacks {error}; delete the folder and render the pair again.") from None
    for eye in EYES:
        if not pair.image(eye).is_file():
            raise IcyMoonError(f"{pair.image(eye)} is missing; delete the folder and render the pair again.")
    return pair


def is_complete(folder: Path) -> bool:
    """Whether a pair is there: ``pair.json``, which is written last, and images of the sizes that it states."""
    try:
        files = json.loads((folder / "pair.json").read_text(encoding="utf-8"))["files"]
        return all((folder / name).stat().st_size == fact["bytes"] for name, fact in files.items())
    except (OSError, ValueError, KeyError, TypeError):
        return False


def restate(folder: Path, settings: Settings) -> None:
    """Let a complete pair state these settings of the camera response, which need no new render."""
    path = folder / "pair.json"
    with disk_errors("read", path):
        data = json.loads(path.read_text(encoding="utf-8"))
    now = merged(data["settings"], response(settings))
    if now != data["settings"]:
        write_json(path, {**data, "settings": now})


def pair_folders(path: Path) -> list[Path]:
    """Folders of the complete pairs at ``path``: a pair folder, a ``pairs`` folder or a data set.

    Raises IcyMoonError if there is none.
    """
    if (path / "pair.json").is_file():
        return [path.resolve()]
    root = path / "pairs" if (path / "pairs").is_dir() else path
    folders = sorted(p.parent for p in root.glob("*/pair.json") if not p.parent.name.endswith(PART))
    if not folders:
        raise IcyMoonError(f"{path} holds no complete stereo pair; render one first or choose another folder.")
    return folders


def find_pairs(path: Path) -> list[Pair]:
    """The complete pairs at ``path``, read; see ``pair_folders`` and ``read_pair``."""
    return [read_pair(folder) for folder in pair_folders(path)]


def changed_files(pair: Pair) -> list[str]:
    """Names of the pair's files whose content is no longer what was rendered."""
    return [name for name, fact in pair.data["files"].items()
            if not (pair.folder / name).is_file() or sha256(pair.folder / name) != fact["sha256"]]
