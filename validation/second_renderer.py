"""Scenes rendered in Cycles and in Mitsuba 3, a renderer that others wrote."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import IcyMoonError
from ..render.pairs.pair_folder import Pair
from ..render.workers.process import clean_environment
from ..settings.description import check, defaults, merged
from ..system import run
from ..typed_settings import Settings
from ..version import ROOT
from .comparison import Bench, Comparison, Row

_COLUMNS, _ROWS, _ACROSS = 160, 120, 8
#: Light paths per pixel: of sunlight alone, which has no noise but at edges, and of all other light.
_DIRECT_SAMPLES, _SAMPLES = 64, 256
_DIRECT, _BOUNCED, _DEPTH, _EDGE_PX = 0.005, 0.01, 1e-5, 0.5
#: Regions darker than this share of the mean are compared with it: their own light is noise.
_FLOOR = 0.02
_LIMIT_S = 1800.0


@dataclass(frozen=True)
class Scene:
    """A scene of the comparison: what differs from the common settings, and how many bounces."""

    name: str
    changes: Mapping[str, Mapping[str, Any]]
    bounces: int = 0
    why: str = ""

    @property
    def samples(self) -> int:
        """Light paths per pixel."""
        return _SAMPLES if self.bounces or "planet" in self.changes.get("light", {}) else _DIRECT_SAMPLES


_LAMBERT = {"model": "LAMBERT", "albedo": 0.8}
_HAPKE = {"model": "HAPKE"}
_HORIZON = {"rig": {"pitch_deg": 12.0}, "light": {"sun_elevation_deg": 30.0, "sun_azimuth_deg": 250.0}}
_TURNED_AWAY = ("Cause, for most of it: Mitsuba draws black where a shading normal turns away from a camera that sees "
                "the facet; Cycles does not")
_LOW = {"light": {"sun_elevation_deg": 20.0, "sun_azimuth_deg": 300.0}}
_COARSE = ("Likely cause, for a part tested: facets of several pixels that turn from the Sun, where the smooth normal "
           "still faces it, are lit in Cycles and black in Mitsuba")
_EDGE = ("Likely cause: the edge of the horizon is a tenth of a pixel apart, in regions with four rows of ground; the "
         "filters of both differ")
_SHADOW_EDGE = "Likely cause: the edge of a deep shadow is a tenth of a pixel apart, in regions that it crosses"
SCENES = (
    Scene("low Sun", {"surface": _LAMBERT, "light": {"sun_elevation_deg": 8.0, "sun_azimuth_deg": 230.0}}),
    Scene("grazing view to the horizon", {"surface": _LAMBERT, **_HORIZON}, why=_TURNED_AWAY),
    Scene("the same, Hapke by OSL", {"surface": _HAPKE, "hapke": {"backend": "OSL"}, **_HORIZON}, why=_EDGE),
    Scene("the same, Hapke by nodes", {"surface": _HAPKE, "hapke": {"backend": "NODES"}, **_HORIZON}, why=_EDGE),
    Scene("Saturn's light alone", {"surface": _LAMBERT, "light": {
        "sun_elevation_deg": -20.0, "sun_azimuth_deg": 200.0, "planet": True, "planet_elevation_deg": 40.0,
        "planet_azimuth_deg": 250.0, "planet_flattening": 0.098}},
        why="Likely cause: noise, which is 0.2 % of a region here"),
    Scene("deep shadow, three bounces", {
        "surface": _LAMBERT, "terrain": {"rms_slope_deg": 25.0}, **_LOW}, bounces=3, why=_SHADOW_EDGE),
    Scene("the same on the default mesh", {
        "surface": _LAMBERT, "terrain": {"rms_slope_deg": 25.0, "inner_scale_m": 0.02},
        "mesh": {"edge_px": 8.0, "error_px": 1.0}, **_LOW}, bounces=3, why=_COARSE),
    Scene("opposition, Hapke", {"surface": _HAPKE, "hapke": {"backend": "OSL"}, "light": {
        "sun_elevation_deg": 40.0, "sun_azimuth_deg": 180.0}}),
    Scene("rocks, three bounces", {"surface": _LAMBERT, "rocks": {"coverage": 0.15}, "light": {
        "sun_elevation_deg": 35.0, "sun_azimuth_deg": 240.0}}, bounces=3),
)


def describe_scene(scene: Scene) -> Settings:
    """The complete settings of a scene."""
    common = {"surface": {"albedo_variation": 0.0, "grain_amplitude_m": 0.0},
              "terrain": {"rms_slope_deg": 10.0, "size_m": 20.0, "inner_scale_m": 0.4},
              "mesh": {"edge_px": 1.5, "error_px": 0.1},
              "rig": {"width_px": _COLUMNS, "height_px": _ROWS, "pitch_deg": 50.0},
              "quality": {"samples": scene.samples, "denoiser": "NONE", "noise_threshold": 0.0,
                          "diffuse_bounces": scene.bounces}}
    return merged(defaults(), check(common, "second renderer"), check(dict(scene.changes), scene.name))


def _render_in_mitsuba(folder: Path, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Radiance (H, W) and depth (H, W) of an exported scene, rendered in a process of its own.

    Mitsuba ends its process if it does not get on with LLVM. Raises IcyMoonError if it is not installed or fails.
    """
    if importlib.util.find_spec("mitsuba") is None:
        raise IcyMoonError("Mitsuba is not installed; run pip install 'icymoon[validate]'.")
    script = ROOT / "stereo" / "adapters" / "mitsuba_render.py"
    scene = folder / "scene_left.xml"
    done = run([sys.executable, str(script), str(scene), str(samples)], clean_environment(), timeout_s=_LIMIT_S)
    if done.returncode:
        lines = [line for line in (done.stderr + done.stdout).splitlines() if "rror" in line]
        raise IcyMoonError(f"Mitsuba fails ({lines[-1].strip() if lines else f'status {done.returncode}'}); it needs "
                           "an LLVM library that its version knows, see DRJIT_LIBLLVM_PATH in its manual.")
    radiance, depth = (np.load(folder / f"scene_left_{name}.npy") for name in ("radiance", "depth"))
    return np.asarray(radiance[..., 0], np.float64), depth


def region_means(image: np.ndarray) -> np.ndarray:
    """Means (8, 8) of an image whose sides are multiples of 8."""
    rows, columns = image.shape
    return np.asarray(image.reshape(_ACROSS, rows // _ACROSS, _ACROSS, columns // _ACROSS).mean(axis=(1, 3)))


def edge_shift_px(one: np.ndarray, other: np.ndarray) -> float:
    """Mean distance in pixels between the edges of two masks: the area between them over the length of the edges.

    0 where there are no edges.
    """
    length = sum(int(np.count_nonzero(np.diff(one.astype(np.int8), axis=axis))) for axis in (0, 1))
    return float(np.count_nonzero(one != other) / length) if length else 0.0


def _rows(scene: Scene, pair: Pair, folder: Path) -> list[Row]:
    from ..stereo.images.exr import read_view  # which needs OpenEXR

    view = read_view(pair.image("left"))
    ours, (theirs, depth) = view.radiance[..., 0].astype(np.float64), _render_in_mitsuba(folder, scene.samples)
    here, there = region_means(ours), region_means(theirs)
    difference = (here - there) / np.maximum(there, _FLOOR * there.mean())
    worst = np.unravel_index(np.argmax(np.abs(difference)), difference.shape)
    both = ~np.isnan(view.depth) & ~np.isnan(depth)
    apart = np.abs(view.depth[both] / depth[both] - 1)
    dark = 0.25 * float(np.median(theirs[theirs > 0]))
    allowed = _BOUNCED if scene.bounces else _DIRECT
    source = f"Mitsuba 3, {scene.samples} samples, the exported scene"
    found = [Row(f"{scene.name}: mean radiance over Mitsuba's", float(ours.sum() / theirs.sum()), 1.0, allowed, source,
                 why=scene.why),
             Row(f"{scene.name}: RMS of 64 regions", float(np.sqrt(np.mean(difference ** 2))), 0.0, allowed, source,
                 why=scene.why),
             Row(f"{scene.name}: largest difference of 64 regions, row {worst[0] + 1}, column {worst[1] + 1}",
                 float(difference[worst]), 0.0, allowed, source, why=scene.why),
             Row(f"{scene.name}: depth, relative, 99 % of the pixels", float(np.quantile(apart, 0.99)), 0.0, _DEPTH,
                 source)]
    if not scene.bounces and "planet" not in scene.changes.get("light", {}):
        found.append(Row(f"{scene.name}: shadow edges", edge_shift_px(ours < dark, theirs < dark), 0.0, _EDGE_PX,
                         source, unit="px"))
    return found


def _compare(bench: Bench) -> list[Row]:
    from ..stereo.export.mitsuba import export_mitsuba  # which needs OpenCV

    if importlib.util.find_spec("mitsuba") is None:
        raise IcyMoonError("Mitsuba is not installed; run pip install 'icymoon[validate]'.")
    pairs = bench.render([describe_scene(scene) for scene in SCENES])
    folders = export_mitsuba(pairs, bench.folder / "mitsuba", bench.blender, bench.say)
    return [row for scene, pair, folder in zip(SCENES, pairs, folders, strict=True)
            for row in _rows(scene, pair, folder)]


COMPARISON = Comparison(
    "mitsuba", "A second renderer",
    "Scenes rendered in Cycles and, from the export `--format mitsuba`, in Mitsuba 3 (`pip install "
    "'icymoon[validate]'`): the same meshes, camera, Sun's disc and planet, other code for everything else. Radiance "
    "is compared in 64 regions of the left image; regions darker than 2 % of the mean are compared with that. Both "
    "images have noise, about 0.1 % of a region in sunlight and 0.5 % with three bounces. Hapke's law is our own "
    "there, so its scenes compare geometry and light, not the formula. Triangles are as fine as pixels and "
    "the ground is smooth at their size, but in one scene. Mesh, pitch and smallest feature were chosen so "
    "after a first run, in which regions with coarse facets differed by up to 14 %. The scene \"the same on "
    "the default mesh\", which has the default's smallest feature too on ground steeper than the default's, "
    "shows what to expect of such meshes. Two causes were tested, by rays that find the direct sunlight on "
    "such facets (48 a pixel). In the grazing view 0.4 % RMS and 2 % in a region are left without them, on "
    "the default mesh 2.6 % RMS and 8 % in a region, whose cause is not known. Other causes were not tested.",
    _compare, quick=False)
