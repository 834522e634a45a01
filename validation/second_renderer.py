"""Compares scenes rendered in Cycles and in Mitsuba 3, an independent renderer."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.ply import read_triangles, write_triangles
from ..render.pairs.pair_folder import Pair
from ..render.workers.process import clean_environment
from ..settings.description import check, defaults, merged
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.system import run
from ..support.version import ROOT
from .comparison import Bench, Comparison, Row

#: Columns of the images.
_COLUMNS = 160
#: Rows of the images.
_ROWS = 120
#: Number of compared regions along each side of an image.
_REGIONS_PER_SIDE = 8
#: Largest relative difference of direct light.
_DIRECT_TOLERANCE = 0.005
#: Largest relative difference with bounces.
_BOUNCED_TOLERANCE = 0.01
#: Largest relative difference of depth.
_DEPTH_TOLERANCE = 1e-5
#: Largest shift of an edge in pixels.
_EDGE_TOLERANCE_PX = 0.5
#: Regions darker than this share of the mean are compared with the mean, because their own light is noise.
_DARK_REGION_SHARE = 0.02
_RENDER_TIMEOUT_S = 1800.0


@dataclass(frozen=True)
class Scene:
    """A scene of the comparison: its changes of the common settings, its number of bounces, and its light paths per
    pixel.

    With ``flat``, it takes the ground of the previous scene as facets that share no vertex, so both renderers shade it
    flat.
    """

    name: str
    changes: Mapping[str, Mapping[str, Any]]
    bounces: int = 0
    samples: int = 64
    why: str = ""
    flat: bool = False


_LAMBERT = {"model": "LAMBERT", "albedo": 0.8}
_HAPKE, _SNOW = {"model": "HAPKE"}, {"model": "SNOW", "albedo": 0.95}
_HORIZON = {"rig": {"pitch_deg": 12.0}, "light": {"sun_elevation_deg": 30.0, "sun_azimuth_deg": 250.0}}
_TURNED_AWAY = (
    "Cause, by the scene with flat facets: Mitsuba draws Lambert's law black where a shading normal turns "
    "away from a camera that sees the facet; Cycles does not. With a law that is not black there, 3.4 % "
    "become 0.3 % (`python benchmarks shading_normals`)"
)
_TURNED_FROM_SUN = (
    "Cause, by the scene with flat facets: on a facet that turns from the Sun, where the smooth normal "
    "does not, Cycles lets the sunlight in and Mitsuba does not"
)
_BEHIND = {"sun_elevation_deg": 40.0, "sun_azimuth_deg": 180.0}
_LOW = {"light": {"sun_elevation_deg": 20.0, "sun_azimuth_deg": 300.0}}
_COARSE = (
    "Cause, by the default mesh with flat facets: shading normals. The renderers differ on facets that "
    "turn from the Sun or from the camera where the smooth normal does not, and here facets are several pixels "
    "wide. With a law that is not black there, and without the 16 % of the pixels that see facets turned from "
    "the Sun, an RMS of 5.1 % becomes 0.8 % (`python benchmarks shading_normals`)"
)
_DARK = (
    "Cause: noise of dark regions. Renders in Mitsuba with other seeds (`mitsuba_render.py SCENE SAMPLES SEED`) "
    "differ as much"
)
_STEEP = {"rms_slope_deg": 25.0}
_DEFAULT: Mapping[str, Mapping[str, Any]] = {
    "surface": _LAMBERT,
    "terrain": {**_STEEP, "inner_scale_m": 0.02},
    "mesh": {"edge_px": 8.0, "error_px": 1.0},
    **_LOW,
}
#: Ways in which Cycles renders a law other than Lambert's, and their names in scenes.
_BACKEND_NAMES = {"OSL": "OSL", "NODES": "nodes"}
SCENES = (
    Scene("low Sun", {"surface": _LAMBERT, "light": {"sun_elevation_deg": 8.0, "sun_azimuth_deg": 230.0}}),
    Scene("grazing view to the horizon", {"surface": _LAMBERT, **_HORIZON}, samples=256, why=_TURNED_AWAY),
    Scene("the same with flat facets", {"surface": _LAMBERT, **_HORIZON}, samples=256, flat=True),
    *(
        Scene(
            f"grazing view, {law} by {name}",
            {"surface": surface, "hapke": {"backend": backend}, **_HORIZON},
            samples=256,
            why=_TURNED_FROM_SUN,
        )
        for law, surface in (("Hapke", _HAPKE), ("snow", _SNOW))
        for backend, name in _BACKEND_NAMES.items()
    ),
    Scene(
        "Saturn's light alone",
        {
            "surface": _LAMBERT,
            "light": {
                "sun_elevation_deg": -20.0,
                "sun_azimuth_deg": 200.0,
                "planet": True,
                "planet_elevation_deg": 40.0,
                "planet_azimuth_deg": 250.0,
                "planet_flattening": 0.098,
            },
        },
        samples=1024,
    ),
    Scene(
        "deep shadow, three bounces",
        {"surface": _LAMBERT, "terrain": _STEEP, **_LOW},
        bounces=3,
        samples=1024,
        why=_DARK,
    ),
    Scene("deep shadow on the default mesh", _DEFAULT, bounces=3, samples=256, why=_COARSE),
    Scene("the default mesh with flat facets", _DEFAULT, bounces=3, samples=1024, why=_DARK, flat=True),
    Scene("opposition, Hapke", {"surface": _HAPKE, "hapke": {"backend": "OSL"}, "light": _BEHIND}),
    Scene("opposition, snow", {"surface": _SNOW, "hapke": {"backend": "OSL"}, "light": _BEHIND}),
    Scene(
        "rocks, three bounces",
        {
            "surface": _LAMBERT,
            "rocks": {"coverage": 0.15},
            "light": {"sun_elevation_deg": 35.0, "sun_azimuth_deg": 240.0},
        },
        bounces=3,
        samples=256,
    ),
)


def describe_scene(scene: Scene) -> Settings:
    """Return the complete settings of a scene."""
    common = {
        "surface": {"albedo_variation": 0.0, "grain_amplitude_m": 0.0},
        "terrain": {"rms_slope_deg": 10.0, "size_m": 20.0, "inner_scale_m": 0.4},
        "mesh": {"edge_px": 1.5, "error_px": 0.1},
        "rig": {"width_px": _COLUMNS, "height_px": _ROWS, "pitch_deg": 50.0},
        "quality": {
            "samples": scene.samples,
            "denoiser": "NONE",
            "noise_threshold": 0.0,
            "diffuse_bounces": scene.bounces,
        },
    }
    return merged(defaults(), check(common, "second renderer"), check(dict(scene.changes), scene.name))


def write_facets(mesh: Path, target: Path) -> None:
    """Rewrite an exported mesh with three separate vertices for each triangle, so that no renderer smooths it.

    Triangles are larger by a thousandth: vertices in one place would be merged, and gaps would let light through.
    """
    vertices, triangles = read_triangles(mesh)
    corners = vertices[triangles].astype(np.float64)
    middle = corners.mean(axis=1, keepdims=True)
    write_triangles(
        target, (middle + 1.001 * (corners - middle)).reshape(-1, 3), np.arange(triangles.size).reshape(-1, 3)
    )


def _describe_facets(scene: Scene, mesh: Path) -> Settings:
    return merged(
        describe_scene(scene),
        check({"source": {"kind": "MESH", "file": str(mesh.absolute()), "centre": False, "up_axis": "Z"}}, scene.name),
    )


def _render_in_mitsuba(folder: Path, samples: int) -> tuple[Array, Array]:
    """Render an exported scene in a separate process. Returns radiance (H, W) and depth (H, W).

    Mitsuba ends its process if it cannot use the LLVM library. Raises IcyMoonError if it is not installed or fails.
    """
    if importlib.util.find_spec("mitsuba") is None:
        raise IcyMoonError('Mitsuba is not installed; run pip install "icymoon[validate]".')
    script = ROOT / "stereo" / "adapters" / "mitsuba_render.py"
    scene = folder / "scene_left.xml"
    done = run(
        [sys.executable, str(script), str(scene), str(samples)], clean_environment(), timeout_s=_RENDER_TIMEOUT_S
    )
    if done.returncode:
        lines = [line for line in (done.stderr + done.stdout).splitlines() if "rror" in line]
        raise IcyMoonError(
            f"Mitsuba fails ({lines[-1].strip() if lines else f'status {done.returncode}'}); it needs "
            "an LLVM library that its version knows, see DRJIT_LIBLLVM_PATH in its manual."
        )
    radiance, depth = (np.load(folder / f"scene_left_{name}.npy") for name in ("radiance", "depth"))
    return np.asarray(radiance[..., 0], np.float64), depth


def average_regions(image: Array) -> Array:
    """Average an image, whose sides are multiples of 8, in 8 x 8 regions."""
    rows, columns = image.shape
    return np.asarray(
        image.reshape(
            _REGIONS_PER_SIDE, rows // _REGIONS_PER_SIDE, _REGIONS_PER_SIDE, columns // _REGIONS_PER_SIDE
        ).mean(axis=(1, 3))
    )


def measure_edge_shift_px(one: Array, other: Array) -> float:
    """Measure the mean distance in pixels between the edges of two masks: the area between them divided by the length
    of the first mask's edges. 0 without edges."""
    length = sum(int(np.count_nonzero(np.diff(one.astype(np.int8), axis=axis))) for axis in (0, 1))
    return float(np.count_nonzero(one != other) / length) if length else 0.0


def draw_twins(ours: Array, theirs: Array) -> Array:
    """Draw a picture (H, 3 W, 3), uint8: both images and their ratio, grey where they are equal, red where ours is 10 %
    brighter."""
    white = max(float(np.quantile(theirs, 0.99)), 1e-30)
    shown = [np.repeat(np.clip(image / white, 0, 1)[..., None] ** (1 / 2.2), 3, axis=-1) for image in (ours, theirs)]
    apart = np.clip((ours - theirs) / np.maximum(theirs, _DARK_REGION_SHARE * theirs.mean()) / 0.1, -1, 1)[..., None]
    colour = 0.5 + 0.5 * np.abs(apart) * np.where(apart > 0, (1.0, -1.0, -1.0), (-1.0, -1.0, 1.0))
    return np.asarray(np.round(255 * np.concatenate([*shown, colour], axis=1)), np.uint8)


def _compare_regions(ours: Array, theirs: Array) -> tuple[float, float, str]:
    """Compare the regions of two images. Returns the RMS and the largest relative difference, and the name of the
    region with the largest."""
    here, there = average_regions(ours), average_regions(theirs)
    difference = (here - there) / np.maximum(there, _DARK_REGION_SHARE * there.mean())
    worst = np.unravel_index(np.argmax(np.abs(difference)), difference.shape)
    return (
        float(np.sqrt(np.mean(difference**2))),
        float(difference[worst]),
        f"largest difference of 64 regions, row {worst[0] + 1}, column {worst[1] + 1}",
    )


def _make_scene_rows(scene: Scene, ours: Array, seen: Array, theirs: Array, depth: Array) -> list[Row]:
    """Make the rows of a scene from radiance and depth (H, W) of Cycles and of Mitsuba."""
    rms, largest, where = _compare_regions(ours, theirs)
    both = ~np.isnan(seen) & ~np.isnan(depth)
    apart = np.abs(seen[both] / depth[both] - 1)
    dark = 0.25 * float(np.median(theirs[theirs > 0]))
    allowed = _BOUNCED_TOLERANCE if scene.bounces else _DIRECT_TOLERANCE
    source = f"Mitsuba 3 rendered the exported scene with {scene.samples} samples per pixel"
    found = [
        Row(
            f"{scene.name}: mean radiance over Mitsuba's",
            float(ours.sum() / theirs.sum()),
            1.0,
            allowed,
            source,
            why=scene.why,
        ),
        Row(f"{scene.name}: RMS of 64 regions", rms, 0.0, allowed, source, why=scene.why),
        Row(f"{scene.name}: {where}", largest, 0.0, allowed, source, why=scene.why),
        Row(
            f"{scene.name}: depth, relative, 99 % of the pixels",
            float(np.quantile(apart, 0.99)),
            0.0,
            _DEPTH_TOLERANCE,
            source,
        ),
    ]
    if not scene.bounces and "planet" not in scene.changes.get("light", {}):
        found.append(
            Row(
                f"{scene.name}: shadow edges",
                measure_edge_shift_px(ours < dark, theirs < dark),
                0.0,
                _EDGE_TOLERANCE_PX,
                source,
                unit="px",
            )
        )
    return found


def _make_backend_rows(radiance: Mapping[str, Array]) -> list[Row]:
    """Make rows of OSL beside nodes, in scenes that differ only in the implementation of their law."""
    rows = []
    for name in radiance:
        if (twin := name.replace("by OSL", "by nodes")) != name:
            _, largest, where = _compare_regions(radiance[name], radiance[twin])
            rows.append(Row(f"{name} beside nodes: {where}", largest, 0.0, _BOUNCED_TOLERANCE, "nodes, in Cycles too"))
    return rows


def _export_all(bench: Bench) -> Iterator[tuple[Scene, Pair, Path]]:
    """Yield the scenes with their pairs and exports, in order."""
    from ..stereo.export.mitsuba import export_mitsuba  # which needs OpenCV

    smooth = [scene for scene in SCENES if not scene.flat]
    pairs = bench.render([describe_scene(scene) for scene in smooth])
    folders = export_mitsuba(pairs, bench.folder / "mitsuba", bench.blender, bench.say)
    done = {scene.name: (pair, folder) for scene, pair, folder in zip(smooth, pairs, folders, strict=True)}
    described: list[Settings] = []
    for before, scene in pairwise(SCENES):
        if scene.flat:
            mesh = bench.folder / f"facets_{len(described)}.ply"
            write_facets(done[before.name][1] / "terrain.ply", mesh)
            described.append(_describe_facets(scene, mesh))
    pairs = bench.render(described)
    folders = export_mitsuba(pairs, bench.folder / "mitsuba", bench.blender, bench.say)
    flat = iter(zip(pairs, folders, strict=True))
    for scene in SCENES:
        yield scene, *(next(flat) if scene.flat else done[scene.name])


def _compare_renderers(bench: Bench) -> list[Row]:
    if importlib.util.find_spec("mitsuba") is None:
        raise IcyMoonError('Mitsuba is not installed; run pip install "icymoon[validate]".')
    from ..stereo.images.exr import read_view  # which needs OpenEXR

    rows, radiance = [], {}
    for number, (scene, pair, folder) in enumerate(_export_all(bench), 1):
        view = read_view(pair.image("left"))
        radiance[scene.name] = view.radiance[..., 0].astype(np.float64)
        theirs, depth = _render_in_mitsuba(folder, scene.samples)
        rows += _make_scene_rows(scene, radiance[scene.name], view.depth, theirs, depth)
        bench.draw(f"{number:02d}", draw_twins(radiance[scene.name], theirs))
    return [*rows, *_make_backend_rows(radiance)]


COMPARISON = Comparison(
    "mitsuba",
    "A second renderer",
    "Cycles and Mitsuba 3 render the same scenes: `--format mitsuba` exports them, and `pip install "
    '"icymoon[validate]"` installs Mitsuba. Meshes, camera, disc of the Sun and planet are the same; all other code '
    "differs. Radiance is compared in 64 regions of the left image. A difference is relative to Mitsuba's region, or "
    "to 2 % of the mean where the region is darker. Pictures of both images and of their ratio are written into "
    "`pictures`.\n\n"
    "Hapke's law and the snow law are our own in Mitsuba too, so their scenes compare geometry and light, not "
    "the formula. Triangles are as fine as pixels, and the ground is smooth at their size. The scenes on the "
    "default mesh differ: their ground also has the default's smallest feature and is steeper than the "
    "default's. Scenes with flat facets have the ground of the scene before, with separate vertices for each "
    "triangle. They show the effect of smooth ground's shading normals.",
    _compare_renderers,
    quick=False,
)
