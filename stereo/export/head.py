"""The export ``head``: images, truth and poses of the cameras beside the pairs, for data sets of single cameras.

* ``<pair>/<camera>.png``: the developed image, in 8 bits.
* ``<pair>/<camera>_depth.png``: depth along the optical axis in millimetres, 16 bits, 0 where it is unknown.
* ``<pair>/<camera>_truth.npz``: ``distance_m``, ``depth_m``, ``points_m`` in east, north, up, and if the pair has
  them, ``normal``, ``semantic`` and ``instance``.
* ``<pair>/cameras.json``: the cameras as in ``pair.json``, with their exposures.
* ``scene-0000.json``, nerfstudio's ``transforms.json``, and ``scene-0000/sparse/0``, cameras and images of COLMAP:
  all images of a scene whose lens the format can hold. Names of images are relative to the export.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.calibrations.registry import FORMATS, write_calibration
from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ...physics.camera.head_camera import HeadCamera
from ...render.pairs.pair_folder import Pair, read_unchanged_pair
from ...render.pairs.scene_splits import name_scene
from ...settings.description import merged, override
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.files import write_json
from ..images.develop import to_8_bit
from ..images.head_views import HeadImage, HeadView, develop_head_view, read_head_views
from ..images.image_files import write_npz, write_png
from ..measure.prepare_pair import list_distinct_pairs
from ..measure.sequences import sort_by_time
from .encodings import MM_PER_M, quantise_to_16_bits
from .plug_in import FoldersContext
from .whole_folders import fill_whole_folder

TITLES = {"head": "Camera Head: images, depth, points and poses of the cameras beside the pair"}
#: Formats of a scene's cameras, and the suffix after the scene's name.
_MODELS = {"transforms": ".json", "colmap": "/sparse/0"}


def write_folders(folders: Sequence[Path], out: Path, context: FoldersContext) -> None:
    """Write the cameras beside the pairs of ``folders``. Raises IcyMoonError if a pair has no such cameras."""
    response = merged(*map(override, context.changes))
    scenes: dict[str, list[CalibratedCamera]] = {}
    lost: dict[str, int] = {}
    found = sort_by_time(list_distinct_pairs(folders))
    with context.progress("Exporting") as tell:
        for done, folder in enumerate(found, 1):
            pair = read_unchanged_pair(folder)
            if not pair.head:
                raise IcyMoonError(
                    f"{folder} has no cameras beside the pair; state rig.head_file and render it again, or choose "
                    "another export."
                )
            for sentence in _write_pair(pair, merged(pair.settings, response), out):
                lost[sentence] = lost.get(sentence, 0) + 1
            scenes.setdefault(name_scene(pair), []).extend(_list_models(pair))
            tell({"type": "progress", "fraction": done / len(found), "message": folder.name})
    for sentence, count in lost.items():
        context.warn(f"In {count} images {sentence}.")
    for number, cameras in enumerate(scenes.values()):
        _write_models(cameras, out, f"scene-{number:04d}", context)


def _write_pair(pair: Pair, settings: Settings, out: Path) -> list[str]:
    """Write the cameras of a pair; return the losses by 16 bits as clauses."""
    entries: list[dict[str, Any]] = []
    lost: list[str] = []
    with fill_whole_folder(out / pair.folder.name) as folder:
        for view, stated in zip(read_head_views(pair), pair.data["head"], strict=True):
            image = develop_head_view(pair, view, settings)
            lost += _write_view(view, image, settings, folder)
            kept = {key: value for key, value in stated.items() if key not in ("image", "truth")}
            entries.append({**kept, "image": f"{view.camera.name}.png", "exposure_s": image.exposure_s})
        write_json(folder / "cameras.json", {"pair": pair.id, "cameras": entries, "sensor": settings.sensor})
    return lost


def _write_view(view: HeadView, image: HeadImage, settings: Settings, folder: Path) -> list[str]:
    name, depth = view.camera.name, view.depth_m
    write_png(folder / f"{name}.png", to_8_bit(image.for_files(), image.bits, settings.sensor.encoding))
    steps, losses = quantise_to_16_bits(np.where(depth > 0, depth, np.nan), MM_PER_M, "depth", "m")
    write_png(folder / f"{name}_depth.png", steps)
    known = {"normal": view.normal, "semantic": view.semantic, "instance": view.instance}
    write_npz(
        folder / f"{name}_truth.npz",
        {
            "distance_m": view.distance_m.astype(np.float32),
            "depth_m": depth.astype(np.float32),
            "points_m": view.points_m.astype(np.float32),
            **{key: values for key, values in known.items() if values is not None},
        },
    )
    return [f"depth is {loss.why}; it is whole in the .npz files" for loss in losses]


def _list_models(pair: Pair) -> list[CalibratedCamera]:
    """List the cameras of a pair that have a lens, with their poses in the world, named after their images."""
    return [_place(camera, pair) for camera in pair.head if isinstance(camera.projection, CalibratedCamera)]


def _place(camera: HeadCamera, pair: Pair) -> CalibratedCamera:
    assert isinstance(camera.projection, CalibratedCamera)
    rotation = camera.rotation.T
    placed = camera.projection.placed(rotation, -rotation @ camera.position_m)
    return replace(placed, name=f"{pair.folder.name}/{camera.name}.png")


def _write_models(cameras: list[CalibratedCamera], out: Path, scene: str, context: FoldersContext) -> None:
    for kind, suffix in _MODELS.items():
        held = [camera for camera in cameras if not FORMATS[kind].why_not(camera)]
        if held:
            write_calibration(CalibratedRig(tuple(held)), [out / f"{scene}{suffix}"], kind)
        if len(held) < len(cameras):
            context.warn(f"{scene}{suffix} lacks {len(cameras) - len(held)} images, whose lens the format cannot hold.")
