"""Whether shading normals explain the differences of Cycles and Mitsuba, in the two smooth scenes with the largest
differences.

    python -m icymoon validate --only mitsuba
    python benchmarks shading_normals out/validation/mitsuba

Mitsuba renders each export as it is, and with a Lambert law that is not black where a shading normal turns away from a
camera that sees the facet. Then the pixels are left out that see a facet which is turned from the Sun while its shading
normal is not. If shading normals explain a difference, one of these changes removes it. Prints the share of the pixels
that are left, the mean radiance of Cycles over Mitsuba's, and RMS and largest difference of 64 regions.
"""

from __future__ import annotations

import argparse
import math
import re
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from icymoon.stereo.adapters.mitsuba_hapke import register_bsdf
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from icymoon.validation.comparison import Bench
from icymoon.validation.second_renderer import SCENES, average_regions, describe_scene

if TYPE_CHECKING:
    import mitsuba

SCENE_NAMES = ("grazing view to the horizon", "deep shadow on the default mesh")
NEVER_BLACK = '<bsdf type="never_black"><float name="albedo" value="0.8"/></bsdf>'
SAMPLES, FINER = 128, 8
#: Regions with a smaller share of pixels left are not compared.
MIN_LEFT = 0.1


def find_turned_from_sun(mi: ModuleType, scene: mitsuba.Scene, shape: tuple[int, int], sun: Array) -> Array:
    """Mask (H, W) of pixels whose facet faces away from the Sun while its shading normal faces it."""
    found = np.zeros(shape, bool)
    offsets = (np.arange(FINER) + 0.5) / FINER
    for down in offsets:
        for right in offsets:
            v, u = np.meshgrid(
                (np.arange(shape[0]) + down) / shape[0], (np.arange(shape[1]) + right) / shape[1], indexing="ij"
            )
            ray, _ = scene.sensors()[0].sample_ray(
                0.0, 0.5, mi.Point2f(u.ravel().astype(np.float32), v.ravel().astype(np.float32)), mi.Point2f(0.5, 0.5)
            )
            hit = scene.ray_intersect(ray)
            facet, smooth = (sun @ np.array(normal).reshape(3, -1) for normal in (hit.n, hit.sh_frame.n))
            found |= (np.array(hit.is_valid()) & (smooth > 0) & (facet <= 0)).reshape(shape)
    return found


def report(name: str, ours: Array, theirs: Array, left: Array) -> None:
    """Print the differences of two images (H, W) in the pixels of a mask (H, W)."""
    share = average_regions(left.astype(float))
    here, there = (average_regions(np.where(left, image, 0.0))[share > MIN_LEFT] for image in (ours, theirs))
    difference = (here - there) / np.maximum(there, 0.02 * there.mean())
    print(
        f"  {name:45s} {left.mean():6.1%} left  mean {ours[left].sum() / theirs[left].sum():.4f}  RMS "
        f"{np.sqrt(np.mean(difference**2)):.4f}  largest {difference[np.abs(difference).argmax()]:+.4f}",
        flush=True,
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="what `icymoon validate --only mitsuba` wrote")


def main(options: argparse.Namespace) -> None:
    """Print the differences."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    register_bsdf(
        "never_black", lambda props: {"albedo": float(props["albedo"])}, lambda q, wi, wo: q["albedo"] / math.pi
    )
    folder = options.folder
    scenes = [scene for scene in SCENES if scene.name in SCENE_NAMES]
    for scene, pair in zip(scenes, Bench(folder).render(list(map(describe_scene, scenes))), strict=True):
        ours = read_view(pair.image("left")).radiance[..., 0].astype(np.float64)
        export = folder / "mitsuba" / pair.folder.name
        text = (
            (export / "scene_left.xml")
            .read_text(encoding="utf-8")
            .replace("terrain.ply", str((export / "terrain.ply").absolute()))
        )
        never_black = re.sub(r'<bsdf type="diffuse">.*?</bsdf>', NEVER_BLACK, text, flags=re.DOTALL)
        images = [
            np.array(mi.render(mi.load_string(described), spp=SAMPLES, seed=1))[..., 0].astype(np.float64)
            for described in (text, never_black)
        ]
        turned = find_turned_from_sun(
            mi,
            mi.load_string(text),
            (ours.shape[0], ours.shape[1]),
            np.array(pair.data["light"]["sun"]["direction_to_world"]),
        )
        print(scene.name)
        whole = np.ones(ours.shape, bool)
        report("as exported", ours, images[0], whole)
        report("law not black where normals turn from camera", ours, images[1], whole)
        report("facets turned from the Sun left out", ours, images[0], ~turned)
        report("both", ours, images[1], ~turned)
