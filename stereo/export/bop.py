"""The layout of the BOP benchmark for 6-DoF poses (Hodan et al. 2018; README of bop_toolkit): the lander's links.

The models ``models/obj_000001.ply`` and so on are in millimetres, with the origin at the middle of their box.
``test/000000`` has the left images and ``test/000001`` the right images, one image per pair. Principal points count
from the corner of the first pixel, as in the toolkit's renderer.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.ply import write_triangles
from ...physics.arm.lander_arm import make_solids
from ...physics.arm.silhouette import find_silhouette
from ...physics.arm.solids import Solid
from ...render.pairs.pair_folder import EYES
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import write_json
from ..images.develop import to_8_bit
from ..images.image_files import write_png
from ..measure.prepare_pair import LoadedPair
from .cameras import refuse_row_poses
from .encodings import MM_PER_M, quantise_to_16_bits
from .losses import Each, Loss
from .whole_folders import fill_whole_folder

TITLES = {"bop": "BOP: models, 6-DoF poses and masks of the links of the lander"}
#: Millimetres per step of the 16-bit depth, which then reaches 13 m.
DEPTH_SCALE = 0.2
_MASK_VALUE = 255


@dataclass
class _Models:
    """Models that are written so far: their numbers by link and shape, and their facts."""

    numbers: dict[tuple[str, bytes], int] = field(default_factory=dict)
    centres: dict[int, Array] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)

    def copy(self) -> _Models:
        """Return a copy with the same models."""
        return _Models(dict(self.numbers), dict(self.centres), dict(self.facts))

    def add_link(self, link: str, solid: Solid, folder: Path) -> int:
        """Return the number of a link's model. A new model is written to the folder."""
        key = link, np.round(solid.vertices * MM_PER_M, 3).tobytes()
        if key not in self.numbers:
            number = self.numbers[key] = len(self.numbers) + 1
            low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
            self.centres[number] = (low + high) / 2
            places = (solid.vertices - self.centres[number]) * MM_PER_M
            write_triangles(
                folder / f"obj_{number:06d}.ply",
                places,
                solid.triangles,
                _compute_vertex_normals(solid),
                (f"link {link}",),
            )
            self.facts[str(number)] = _describe_model(places)
            write_json(folder / "models_info.json", self.facts)
        return self.numbers[key]


def _describe_model(places: Array) -> dict[str, float]:
    """Return the diameter and the box of a model in millimetres, as in ``models_info.json``."""
    low, size = places.min(axis=0), np.ptp(places, axis=0)
    # The two vertices farthest apart are the ends of the model in some direction.
    directions = np.random.default_rng(0).normal(size=(2000, 3))
    ends = np.unique((places @ directions.T).argmax(axis=0))
    diameter = max(float(np.linalg.norm(places[ends] - places[k], axis=1).max()) for k in ends)
    return {
        "diameter": diameter,
        **{f"min_{axis}": float(low[k]) for k, axis in enumerate("xyz")},
        **{f"size_{axis}": float(size[k]) for k, axis in enumerate("xyz")},
    }


def _compute_vertex_normals(solid: Solid) -> Array:
    """Compute the unit normal of each vertex, (n, 3): the mean of the triangles around it, weighted by area."""
    a, b, c = (solid.vertices[solid.triangles[:, k]] for k in range(3))
    normals, faces = np.zeros_like(solid.vertices), np.cross(b - a, c - a)
    for k in range(3):
        np.add.at(normals, solid.triangles[:, k], faces)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30))


def write_all(each: Each, out: Path) -> None:
    """Write all pairs with a lander. A pair without a lander is reported as a failure."""
    models = _Models()
    scenes: dict[str, dict[str, dict[str, Any]]] = {eye: {"camera": {}, "gt": {}, "gt_info": {}} for eye in EYES}

    def write(pair: LoadedPair) -> list[Loss]:
        nonlocal models, scenes
        refuse_row_poses(pair)
        lander = pair.pair.data.get("lander")
        if not lander:
            raise IcyMoonError(
                f"{pair.pair.folder}: shows no lander, but BOP's layout describes a lander's links; "
                "render it with lander.kind."
            )
        image = str(len(scenes["left"]["camera"]))
        losses: list[Loss] = []
        solids = make_solids(pair.settings, lander["pads_m"])
        with_this = models.copy()
        described = {}
        with fill_whole_folder(out) as part:
            for number, eye in enumerate(EYES):
                folder = part / "test" / f"{number:06d}"
                losses += _write_image(pair, eye, folder, int(image))
                poses, facts = _write_links(pair, eye, folder, int(image), with_this, solids, part / "models")
                described[eye] = {
                    name: scenes[eye][name] | {image: content}
                    for name, content in (("camera", _make_camera_facts(pair, eye)), ("gt", poses), ("gt_info", facts))
                }
                for name, content in described[eye].items():
                    write_json(folder / f"scene_{name}.json", content)
        models, scenes = with_this, described  # a pair that failed adds nothing
        return losses

    each(write)


def _write_image(pair: LoadedPair, eye: str, folder: Path, image: int) -> list[Loss]:
    """Write the image and the depth of an eye; return the losses of the depth."""
    shown = to_8_bit(pair.images.for_files(eye), pair.images.bits, pair.images.encoding)
    write_png(folder / "rgb" / f"{image:06d}.png", shown if shown.ndim == 3 else np.repeat(shown[..., None], 3, axis=2))
    steps, losses = quantise_to_16_bits(pair.depth[eye], MM_PER_M / DEPTH_SCALE, "depth", "m")
    write_png(folder / "depth" / f"{image:06d}.png", steps)
    return losses


def _list_camera_matrix(pair: LoadedPair) -> Array:
    camera = pair.pair.camera.rectified
    return np.array([[camera.focal_px, 0.0, camera.cx_px], [0.0, camera.focal_px, camera.cy_px], [0.0, 0.0, 1.0]])


def _make_camera_facts(pair: LoadedPair, eye: str) -> dict[str, Any]:
    found: dict[str, Any] = {"cam_K": _list_camera_matrix(pair).ravel().tolist(), "depth_scale": DEPTH_SCALE}
    pose = pair.pair.rectified_pose(eye)
    if pose is not None:
        inverse = np.linalg.inv(pose)
        found |= {"cam_R_w2c": inverse[:3, :3].ravel().tolist(), "cam_t_w2c": (inverse[:3, 3] * MM_PER_M).tolist()}
    return found


def _write_links(
    pair: LoadedPair, eye: str, folder: Path, image: int, models: _Models, solids: dict[str, Solid], shapes: Path
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Write the masks of the links in an image, and new models to the folder ``shapes``.

    Return the links' poses, and the counts and boxes of their pixels.
    """
    poses, facts = [], []
    instance, depth = pair.views[eye].instance, pair.depth[eye]
    if instance is None:
        raise IcyMoonError(f"{pair.pair.folder}: has no labels; render it with quality.truth FULL.")
    for number, link in enumerate(pair.pair.data["lander"]["links"]):
        solid, pose = solids[link["name"]], np.array(link[f"link_to_{eye}"], np.float64)
        model = models.add_link(link["name"], solid, shapes)
        turn, place = pose[:3, :3], pose[:3, :3] @ models.centres[model] + pose[:3, 3]
        whole = find_silhouette(
            solid.vertices @ turn.T + pose[:3, 3], solid.triangles, _list_camera_matrix(pair), depth.shape
        )
        seen = instance == link["instance"]
        poses.append({"obj_id": model, "cam_R_m2c": turn.ravel().tolist(), "cam_t_m2c": (place * MM_PER_M).tolist()})
        facts.append(_make_pixel_facts(whole | seen, seen, depth))
        for name, mask in (("mask", whole | seen), ("mask_visib", seen)):
            write_png(folder / name / f"{image:06d}_{number:06d}.png", np.where(mask, _MASK_VALUE, 0).astype(np.uint8))
    return poses, facts


def _make_pixel_facts(whole: Array, seen: Array, depth: Array) -> dict[str, Any]:
    every = int(whole.sum())
    return {
        "bbox_obj": _find_bounding_box(whole),
        "bbox_visib": _find_bounding_box(seen),
        "px_count_all": every,
        "px_count_valid": int((whole & np.isfinite(depth)).sum()),
        "px_count_visib": int(seen.sum()),
        "visib_fract": float(seen.sum() / every) if every else 0.0,
    }


def _find_bounding_box(mask: Array) -> list[int]:
    """Return x, y, width and height of a mask's box; -1 for an empty box, as BOP defines it."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return [-1, -1, -1, -1]
    return [int(columns[0]), int(rows[0]), int(columns[-1] - columns[0] + 1), int(rows[-1] - rows[0] + 1)]
