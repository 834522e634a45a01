"""Exports pairs, with their truth, in the layouts of other data sets.

* ``png8``, ``png16``, ``pfm``: a folder per pair with ``left`` and ``right``, ``calibration.json``, and for each eye
  ``disparity``, ``depth``, labels and ``visible`` (255 where the other eye sees the point too), as far as the format
  can hold them.
* ``kitti``: KITTI 2015, ``training/image_2/000000_10.png`` and so on; ``pairs.csv`` contains the number of each pair.
* ``middlebury``: Middlebury 2014, ``<pair>/im0.png``, ``disp0.pfm``, ``mask0nocc.png``, ``calib.txt``.
* ``coco``: left and right images, and ``annotations.json`` with a mask for each rock and each of the user's objects.

``plugins/entry_points.txt`` declares these and other exports; ``export`` runs all that read images. Images are
rectified and developed as for the matchers, but in colour if the sensor is a colour sensor; ``pfm`` contains the
radiance itself. An unknown value (sky, or a point that a toed-in eye does not see) is infinity in PFM and 0 in 16-bit
PNG.
"""

from __future__ import annotations

import csv
import io
import itertools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from ...formats.geotiff import MAP_FORMULA
from ...physics.camera.calibration_error import refuse_calibration_errors
from ...physics.camera.stereo_camera import StereoCamera
from ...render.pairs.pair_folder import EYES, describe_rolling_shutter
from ...support.arrays import Array
from ...support.errors import DiskError, IcyMoonError, describe_error
from ...support.files import escape_cell, write_atomically, write_bytes, write_json, write_text
from ...support.labels import LANDER, NOT_SEEN, ROCK, SEMANTIC_NAMES
from ..images.develop import describe_exposure, to_8_bit
from ..images.image_files import write_png
from ..measure.prepare_pair import LoadedPair, list_distinct_pairs, load_pair
from ..measure.sequences import sort_by_time
from . import Export, find_plugins
from .encodings import KITTI_STEPS_PER_PX, MM_PER_M, encode_run_lengths, quantise_to_16_bits, write_pfm
from .losses import Each, Loss, Losses, Write, refuse_losses
from .plug_in import PluginExport
from .whole_folders import fill_whole_folder

Event = Callable[[dict[str, Any]], None]
HEADINGS = {"png8": "Images and Disparity", "coco": "Masks and Cameras"}
TITLES = {
    "png8": "PNG, 8 Bits: images, disparity, depth, labels and visibility of both eyes",
    "png16": "PNG, 16 Bits: images, disparity, depth, labels and visibility of both eyes",
    "pfm": "PFM: radiance, and exact disparity and depth",
    "kitti": "KITTI 2015: images, disparity with and without occluded pixels, calibration",
    "middlebury": "Middlebury 2014: images, disparity, mask of occluded pixels, calibration",
    "coco": "COCO: images of both eyes, with a mask of every rock and object",
}
#: Semantic values that have instances; ground and sky have none.
THINGS = (ROCK, LANDER)
_VISIBLE_VALUE, _HIDDEN_VALUE = 255, 128


def export(
    paths: Sequence[Path],
    kind: str,
    out: Path,
    response: Mapping[str, Mapping[str, Any]] | None = None,
    on_event: Event = lambda event: None,
) -> list[str]:
    """Write all pairs at ``paths`` to ``out`` in the layout ``kind``; return a sentence per failure.

    ``kind`` is the name of an export that reads images. ``response`` overrides settings that need no new render. A pair
    that cannot be used, or would lose most of its disparities, is left out and reported by an event {"type": "error",
    "message"}. A failed self-check, and losses of truth that the layout cannot hold, are reported by {"type":
    "warning", "message"}. Raises IcyMoonError if there is no pair or ``out`` cannot be written.
    """
    pairs = _PairReader(sort_by_time(list_distinct_pairs(paths)), response or {}, on_event)
    PluginExport(find_plugins().usable[kind]).write(pairs.write_each, out)
    pairs.write_map_places(out)
    for sentence in pairs.losses.sentences(pairs.written):
        on_event({"type": "warning", "message": sentence})
    return pairs.failed


class _PairReader:
    """Reads pairs and has them written one by one; a failure does not stop the others."""

    def __init__(self, folders: Sequence[Path], response: Mapping[str, Mapping[str, Any]], on_event: Event) -> None:
        self._folders, self._response, self._tell = folders, response, on_event
        self.failed: list[str] = []
        self.losses, self.written = Losses(), 0
        self._places: dict[str, Any] = {}

    def write_each(self, write: Write) -> None:
        """Read each pair and write it by ``write``. Raises DiskError if the disk refuses."""
        for done, folder in enumerate(self._folders, 1):
            try:
                pair = load_pair(folder, self._response)
                refuse_calibration_errors(pair.settings.calibration_error, folder)
            except Exception as error:
                self._tell_failure(error, folder)
                continue
            if not pair.check.ok:
                problems = "; ".join(pair.check.problems)
                self._tell({"type": "warning", "message": f"{folder} fails its self-check: {problems}."})
            try:
                self.losses.add(pair, write(pair) or ())
                self.written += 1
                if place := (pair.pair.data.get("ground") or {}).get("map"):
                    on_map = pair.pair.data.get("cameras_on_map")
                    self._places[pair.pair.folder.name] = place | ({"cameras": on_map} if on_map else {})
            except DiskError:
                raise
            except Exception as error:
                self._tell_failure(error, folder)
                continue
            self._tell(
                {
                    "type": "progress",
                    "fraction": done / len(self._folders),
                    "done": done,
                    "total": len(self._folders),
                    "message": folder.name,
                }
            )

    def write_map_places(self, out: Path) -> None:
        """Write ``map_coordinates.json``, which places the pairs on maps, if the ground of any pair is from a map."""
        if self._places:
            write_json(out / "map_coordinates.json", {"formula": MAP_FORMULA, "pairs": self._places})

    def _tell_failure(self, error: Exception, folder: Path) -> None:
        self.failed.append(describe_error(error, folder))
        self._tell({"type": "error", "message": self.failed[-1]})


def _get_eye_disparity(pair: LoadedPair, eye: str) -> Array:
    return pair.pair.camera.disparity(pair.depth[eye])


def _get_eye_image(pair: LoadedPair, eye: str) -> Array:
    """Return the image of an eye, grey (H, W) or in colour (H, W, 3) in the order B, G, R."""
    return pair.images.for_files(eye)


def _write_8_bit(path: Path, pair: LoadedPair, eye: str) -> None:
    write_png(path, to_8_bit(_get_eye_image(pair, eye), pair.images.bits, pair.images.encoding))


def _describe_calibration(pair: LoadedPair) -> dict[str, Any]:
    return {
        "pair": pair.pair.id,
        "camera": pair.pair.camera.rectified.to_json(),
        "poses_camera_to_world": pair.pair.rectified_poses,
        **describe_rolling_shutter(pair.pair),
        "sensor": pair.settings.sensor,
        **describe_exposure(pair.images),
        "self_check": pair.check.to_json(),
    }


def _write_png8(pair: LoadedPair, folder: Path) -> None:
    for eye in EYES:
        _write_8_bit(folder / f"{eye}.png", pair, eye)
        write_png(folder / f"visible_{eye}.png", pair.visible[eye].astype(np.uint8) * _VISIBLE_VALUE)
        semantic = pair.views[eye].semantic
        if semantic is not None:
            write_png(folder / f"semantic_{eye}.png", semantic.astype(np.uint8))
    write_json(
        folder / "calibration.json", _describe_calibration(pair) | {"semantic": SEMANTIC_NAMES | {NOT_SEEN: "not seen"}}
    )


def _write_png16(pair: LoadedPair, folder: Path) -> list[Loss]:
    labels = _list_instance_labels(pair)
    maps: dict[str, Array] = {}
    losses: list[Loss] = []
    for eye in EYES:
        for what, values, scale, unit in (
            ("disparity", _get_eye_disparity(pair, eye), KITTI_STEPS_PER_PX, "px"),
            ("depth", pair.depth[eye], MM_PER_M, "m"),
        ):
            maps[f"{what}_{eye}"], lost = quantise_to_16_bits(values, scale, what, unit)
            losses += lost
    refuse_losses(pair, losses)
    for name, steps in maps.items():
        write_png(folder / f"{name}.png", steps)
    for eye in EYES:
        write_png(folder / f"{eye}.png", _to_16_bit_image(pair, eye))
        instance = pair.views[eye].instance
        if instance is not None:
            write_png(folder / f"instance_{eye}.png", np.searchsorted(labels, instance).astype(np.uint16))
    write_json(
        folder / "calibration.json",
        _describe_calibration(pair)
        | {
            "disparity_steps_per_px": KITTI_STEPS_PER_PX,
            "depth_steps_per_m": MM_PER_M,
            "instance_labels": {str(k): int(label) for k, label in enumerate(labels)},
        },
    )
    return losses


def _to_16_bit_image(pair: LoadedPair, eye: str) -> Array:
    """Return the image of ``_write_8_bit`` in 16 bits."""
    level = _get_eye_image(pair, eye) / (2.0**pair.images.bits - 1)
    level = np.sqrt(level) if pair.images.encoding == "SQUARE_ROOT" else level
    return np.asarray(np.rint(65535 * level).astype(np.uint16))


def _list_instance_labels(pair: LoadedPair) -> Array:
    """List the instance labels of both eyes in ascending order, from 0. Raises IcyMoonError if they exceed 16 bits."""
    found = [np.unique(view.instance) for view in pair.views.values() if view.instance is not None]
    labels = np.unique(np.concatenate([[0], *found]))
    if len(labels) > 65536:
        raise IcyMoonError(
            f"{pair.pair.folder} shows {len(labels)} instances, but 16-bit images hold at most 65536; use coco."
        )
    return labels


def _write_pfm(pair: LoadedPair, folder: Path) -> None:
    for eye in EYES:
        write_pfm(folder / f"{eye}.pfm", pair.views[eye].radiance)
        write_pfm(folder / f"disparity_{eye}.pfm", _get_eye_disparity(pair, eye))
        write_pfm(folder / f"depth_{eye}.pfm", pair.depth[eye])
    write_json(folder / "calibration.json", _describe_calibration(pair))


def _write_kitti(each: Each, out: Path) -> None:
    """Write the layout of KITTI 2015.

    ``disp_occ_0`` has all true disparities of the left eye, ``disp_noc_0`` only the disparities of points that the
    right eye sees too.
    """
    numbers = [("number", "pair")]

    def write(pair: LoadedPair) -> list[Loss]:
        number = f"{len(numbers) - 1:06d}"
        frame = f"{number}_10.png"
        disparity = _get_eye_disparity(pair, "left")
        every, losses = quantise_to_16_bits(disparity, KITTI_STEPS_PER_PX, "disparity", "px")
        refuse_losses(pair, losses)
        with fill_whole_folder(out) as part:
            root = part / "training"
            _write_8_bit(root / "image_2" / frame, pair, "left")
            _write_8_bit(root / "image_3" / frame, pair, "right")
            write_png(root / "disp_occ_0" / frame, every)
            write_png(root / "disp_noc_0" / frame, np.where(pair.visible["left"], every, 0).astype(np.uint16))
            write_text(root / "calib_cam_to_cam" / f"{number}.txt", _make_kitti_calibration(pair))
        numbers.append((number, escape_cell(pair.pair.folder.name)))
        return losses

    each(write)
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows(numbers)
    write_text(out / "pairs.csv", table.getvalue())


def _make_kitti_calibration(pair: LoadedPair) -> str:
    camera = pair.pair.camera
    lines = []
    # KITTI counts pixels from the centre of the first pixel, half a pixel from our corner.
    for name, shift in (("02", 0.0), ("03", -camera.focal_baseline_px_m)):
        matrix = (camera.focal_px, 0, camera.cx_px - 0.5, shift, 0, camera.focal_px, camera.cy_px - 0.5, 0, 0, 0, 1, 0)
        lines.append(f"S_rect_{name}: {camera.width_px:.6e} {camera.height_px:.6e}\n")
        lines.append(f"P_rect_{name}: {' '.join(f'{value:.12e}' for value in matrix)}\n")
    return "".join(lines)


def _write_middlebury(pair: LoadedPair, folder: Path) -> None:
    for k, eye in enumerate(EYES):
        _write_8_bit(folder / f"im{k}.png", pair, eye)
        write_pfm(folder / f"disp{k}.pfm", _get_eye_disparity(pair, eye))
        known = np.where(np.isfinite(pair.depth[eye]), _HIDDEN_VALUE, 0)
        write_png(folder / f"mask{k}nocc.png", np.where(pair.visible[eye], _VISIBLE_VALUE, known).astype(np.uint8))
    write_text(folder / "calib.txt", _make_middlebury_calibration(pair))


def make_middlebury_text(camera: StereoCamera) -> str:
    """Describe the camera as Middlebury's ``calib.txt``: pixels from the centre of the first pixel, lengths in mm."""
    eyes = "".join(
        f"cam{eye}=[{camera.focal_px:.9g} 0 {camera.cx_px - 0.5 + eye * camera.doffs_px:.9g}; "
        f"0 {camera.focal_px:.9g} {camera.cy_px - 0.5:.9g}; 0 0 1]\n"
        for eye in (0, 1)
    )
    return (
        f"{eyes}doffs={camera.doffs_px:.9g}\nbaseline={1000 * camera.baseline_m:.9g}\n"
        f"width={camera.width_px}\nheight={camera.height_px}\n"
    )


def _make_middlebury_calibration(pair: LoadedPair) -> str:
    """Make the text of Middlebury 2014's ``calib.txt``.

    ``ndisp`` is a sufficient number of disparities, ``vmin`` and ``vmax`` are their range.
    """
    disparity = _get_eye_disparity(pair, "left")
    known = disparity[np.isfinite(disparity)]
    low, high = (int(np.floor(known.min())), int(np.ceil(known.max()))) if known.size else (0, 0)
    return (
        f"{make_middlebury_text(pair.pair.camera)}ndisp={high + 1}\nisint=0\n"
        f"vmin={low}\nvmax={high}\ndyavg=0\ndymax=0\n"
    )


def _write_coco(each: Each, out: Path) -> None:
    categories = [{"id": k, "name": SEMANTIC_NAMES[k], "supercategory": "thing"} for k in THINGS]

    def write_annotations(part: Path) -> None:
        with part.open("w", encoding="utf-8", newline="\n") as stream:
            stream.write(
                f'{{"info": {json.dumps({"description": "Icy Moon"})},\n"categories": '
                f'{json.dumps(categories)},\n"annotations": ['
            )
            images = _write_coco_images(each, out, stream)
            stream.write(f'\n],\n"images": {json.dumps(images)}}}\n')

    write_atomically(out / "annotations.json", write_annotations)


def _write_coco_images(each: Each, out: Path, annotations: TextIO) -> list[dict[str, Any]]:
    """Write all images, write their annotations to a stream, and return the entries of the images."""
    images: list[dict[str, Any]] = []
    numbers = itertools.count(1)

    def write(pair: LoadedPair) -> None:
        camera, names = pair.pair.camera, {eye: f"{pair.pair.folder.name}_{eye}.png" for eye in EYES}
        with fill_whole_folder(out) as folder:
            for eye, name in names.items():
                _write_8_bit(folder / "images" / name, pair, eye)
            every = {
                eye: list(make_coco_annotations(pair.views[eye].instance, pair.views[eye].semantic)) for eye in EYES
            }
        for eye, name in names.items():
            images.append(
                {
                    "id": len(images) + 1,
                    "file_name": name,
                    "width": camera.width_px,
                    "height": camera.height_px,
                    "pair": pair.pair.folder.name,
                    "eye": eye,
                }
            )
            # Masks go to the disk pair by pair, so that many pairs do not fill the memory.
            for annotation in every[eye]:
                number = next(numbers)
                entry = {"id": number, "image_id": len(images), **annotation}
                annotations.write(f"{',' if number > 1 else ''}\n{json.dumps(entry)}")

    each(write)
    return images


def make_coco_annotations(instance: Array | None, semantic: Array | None) -> Iterator[dict[str, Any]]:
    """Yield COCO annotations of the THINGS in an image: mask as run lengths, box (x, y, width, height) and area.

    ``instance`` and ``semantic`` are labels (H, W). The category is the most frequent one among the instance's pixels.
    ``label`` is the number of the instance, the same in both eyes and in every pair of the scene.
    """
    if instance is None or semantic is None:
        return
    height, width = instance.shape
    flat, kinds = instance.ravel(order="F"), semantic.ravel(order="F")
    order = np.argsort(flat, kind="stable")
    labels, starts = np.unique(flat[order], return_index=True)
    for label, pixels in zip(labels.tolist(), np.split(order, starts[1:]), strict=True):
        category = int(np.bincount(np.maximum(kinds[pixels], 0)).argmax())
        if label == 0 or category not in THINGS:
            continue
        columns, rows = pixels // height, pixels % height
        left, top = int(columns.min()), int(rows.min())
        yield {
            "category_id": category,
            "label": label,
            "iscrowd": 0,
            "area": len(pixels),
            "bbox": [left, top, int(columns.max()) - left + 1, int(rows.max()) - top + 1],
            "segmentation": {"size": [height, width], "counts": encode_run_lengths(pixels, height * width)},
        }


PNG8 = Export(write_pair=_write_png8)
PNG16 = Export(write_pair=_write_png16)
PFM = Export(write_pair=_write_pfm)
KITTI = Export(write_all=_write_kitti)
MIDDLEBURY = Export(write_pair=_write_middlebury)
COCO = Export(write_all=_write_coco)


def write_truth(paths: Sequence[Path], out: Path) -> Iterator[dict[str, Any]]:
    """Write ``<out>/<pair>/truth.npz`` of all pairs, and yield the self-check of each, with ``pair``, once it is done.

    An npz contains for both eyes ``disparity_left`` (px) and ``depth_left`` (m), float32, NaN for sky and for points
    that the sensor does not see, and ``visible_left``, bool, true where the other eye sees the point too. A pair that
    cannot be used yields only its ``problems``.
    """
    for folder in list_distinct_pairs(paths):
        try:
            pair = load_pair(folder, {})
        except Exception as error:
            yield {"pair": folder.name, "ok": False, "problems": [describe_error(error, folder)]}
            continue
        stream = io.BytesIO()
        np.savez_compressed(
            stream,
            **{
                f"{name}_{eye}": values
                for eye in EYES
                for name, values in (
                    ("disparity", _get_eye_disparity(pair, eye).astype(np.float32)),
                    ("depth", pair.depth[eye].astype(np.float32)),
                    ("visible", pair.visible[eye]),
                )
            },
        )
        write_bytes(out / folder.name / "truth.npz", stream.getvalue())
        yield {"pair": folder.name, **pair.check.to_json()}
