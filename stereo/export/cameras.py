"""The exports ``cahvor`` and ``colmap``: images with the camera models of rovers, of COLMAP and of nerfstudio."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.cahvor import make_cahvor_text, make_model_from_pinhole, make_pds_text
from ...formats.calibrations.cahv import find_nearest_model
from ...physics.camera.lens_distortion import read_coefficients
from ...physics.camera.rotations import quaternion
from ...physics.camera.stereo_camera import StereoCamera
from ...render.pairs.pair_folder import EYES, refuse_rolling_shutter
from ...settings import rebuilt_parts
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import write_json, write_text
from ..images.develop import to_8_bit
from ..images.image_files import write_png
from ..measure.prepare_pair import LoadedPair
from . import Export
from .losses import Each

TITLES = {
    "cahvor": "CAHVOR: images with the camera models of rovers, and PDS3 labels",
    "colmap": "COLMAP and nerfstudio: images, cameras, poses and true points",
}
#: The coordinate system of the poses, for labels.
FRAME_NAME = "ICYMOON_SITE_EAST_NORTH_UP"
#: Approximate number of points of each pair in a model of COLMAP.
_POINTS_PER_PAIR = 2000


def refuse_row_poses(pair: LoadedPair) -> None:
    """Raise IcyMoonError for a pair with a rolling shutter, because the layout has one pose for all rows."""
    refuse_rolling_shutter(
        pair.pair, "this layout has one pose for all rows", "export tum, flow, raw or png8, or render with readout 0"
    )


def read_pose(pair: LoadedPair, eye: str) -> Array:
    """Read the matrix (4, 4) from an eye's axes to the world's.

    Raises IcyMoonError if the pair lacks it, or if image rows have different matrices.
    """
    refuse_row_poses(pair)
    return read_middle_pose(pair, eye)


def read_middle_pose(pair: LoadedPair, eye: str) -> Array:
    """Read the matrix as ``read_pose``, at the middle of the exposure, also with a rolling shutter."""
    pose = pair.pair.rectified_pose(eye)
    if pose is None:
        raise IcyMoonError(
            f"{pair.pair.folder / 'pair.json'} does not contain the pose of the cameras; render the pair again."
        )
    return pose


def make_pixel_rays(camera: StereoCamera) -> Array:
    """Return the directions (H, W, 3) of the pixels' centres in the camera's axes, with z = 1.

    Directions times planar depth are points.
    """
    v, u = np.mgrid[: camera.height_px, : camera.width_px] + 0.5
    return np.stack(
        [(u - camera.cx_px) / camera.focal_px, (v - camera.cy_px) / camera.focal_px, np.ones_like(u)], axis=-1
    )


def _write_cahvor(pair: LoadedPair, folder: Path) -> None:
    """Write the rectified images of a pair with CAHV models, and the images of the sensors with CAHVOR models.

    The folder gets ``left.png``, ``left.cahvor`` and a PDS3 label, ``left.lbl``. If the lens distorts, or if eyes are
    toed in or calibrated, it also gets ``left_sensor.png`` and so on. World axes are east, north, up, in metres. Raises
    IcyMoonError if the lens cannot be represented in CAHVOR or CAHVORE.
    """
    camera = pair.pair.camera
    k, images = read_coefficients(pair.settings.rig), pair.images
    for eye in EYES:
        pose = read_pose(pair, eye)
        matrix, place, size_px = make_centred_matrix(camera), pose[:3, 3], (camera.width_px, camera.height_px)
        named = {eye: (images.for_files(eye), make_model_from_pinhole(matrix, pose[:3, :3].T, place, size_px))}
        if any(k) or camera.looks_elsewhere:
            turn, own = camera.eye_rotation(eye) @ pose[:3, :3].T, camera.own_eye(eye)
            named[f"{eye}_sensor"] = (
                getattr(images, f"detected_{eye}"),
                make_model_from_pinhole(matrix, turn, place, size_px, k)
                if own is None
                else find_nearest_model(replace(own, name=eye).placed(turn, -turn @ place)),
            )
        for name, (image, model) in named.items():
            write_png(folder / f"{name}.png", to_8_bit(image, images.bits, images.encoding))
            write_text(folder / f"{name}.cahvor", make_cahvor_text(model))
            write_text(folder / f"{name}.lbl", make_pds_text(model, FRAME_NAME))


def make_centred_matrix(camera: StereoCamera) -> Array:
    """Return K with pixels counted from the centre of the first pixel."""
    matrix = np.array(camera.matrix)
    matrix[:2, 2] -= 0.5
    return matrix


@dataclass
class _ColmapModel:
    """Content of a scene's COLMAP model so far."""

    cameras: dict[str, int] = field(default_factory=dict)  # lines without their number
    images: list[str] = field(default_factory=list)
    points: list[str] = field(default_factory=list)
    frames: list[dict[str, Any]] = field(default_factory=list)


def _write_colmap(each: Each, out: Path) -> None:
    """Write COLMAP and nerfstudio files of each scene.

    ``scene-0000/`` gets ``images/``, ``sparse/0/`` with COLMAP's ``cameras.txt``, ``images.txt`` and ``points3D.txt``,
    and nerfstudio's ``transforms.json``. Pairs of the same ground, surface and light are one scene. Images are
    rectified; both programs count pixels from the corner of the first pixel, as we do. Points come from the true depth
    and are seen by both eyes.
    """
    models: dict[str, _ColmapModel] = {}

    def write(pair: LoadedPair) -> None:
        refuse_row_poses(pair)
        model = models.setdefault(_make_scene_key(pair), _ColmapModel())
        folder = out / f"scene-{list(models).index(_make_scene_key(pair)):04d}"
        _add_pair(model, pair, folder)

    each(write)
    for number, model in enumerate(models.values()):
        folder = out / f"scene-{number:04d}"
        sparse = folder / "sparse" / "0"
        write_text(sparse / "cameras.txt", "".join(f"{k} {line}\n" for line, k in model.cameras.items()))
        write_text(sparse / "images.txt", "\n".join(model.images) + "\n")
        write_text(sparse / "points3D.txt", "".join(f"{line}\n" for line in model.points))
        write_json(folder / "transforms.json", {"frames": model.frames})


def _make_scene_key(pair: LoadedPair) -> str:
    parts = [
        part(pair.pair.settings)
        for part in (rebuilt_parts.select_geometry, rebuilt_parts.select_appearance, rebuilt_parts.select_light)
    ]
    return json.dumps(
        [
            parts,
            pair.pair.data.get("own_files_sha256", ""),
            pair.pair.data.get("edited_by_hand", False) and pair.pair.id,
        ]
    )


def _make_frame(file: str, camera: StereoCamera, pose: Array) -> dict[str, Any]:
    """Make a frame of nerfstudio, whose cameras look along -z with y up."""
    return {
        "file_path": file,
        "transform_matrix": (pose @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist(),
        "camera_model": "OPENCV",
        "w": camera.width_px,
        "h": camera.height_px,
        "fl_x": camera.focal_px,
        "fl_y": camera.focal_px,
        "cx": camera.cx_px,
        "cy": camera.cy_px,
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
    }


def _add_pair(model: _ColmapModel, pair: LoadedPair, folder: Path) -> None:
    camera = pair.pair.camera
    line = (
        f"PINHOLE {camera.width_px} {camera.height_px} {camera.focal_px!r} {camera.focal_px!r} {camera.cx_px!r} "
        f"{camera.cy_px!r}"
    )
    number = model.cameras.setdefault(line, len(model.cameras) + 1)
    rows, columns, right_columns = _choose_pixels(pair)
    points = _find_world_points(pair, rows, columns)
    first_image, first_point = len(model.images) // 2 + 1, len(model.points) + 1
    where = {"left": columns + 0.5, "right": right_columns}
    seen = {eye: to_8_bit(pair.images.for_files(eye), pair.images.bits, pair.images.encoding) for eye in EYES}
    for k, eye in enumerate(EYES):
        name = f"{pair.pair.folder.name}_{eye}.png"
        write_png(folder / "images" / name, seen[eye])
        pose = read_pose(pair, eye)
        rotation = pose[:3, :3].T
        placed = [*quaternion(rotation), *(-rotation @ pose[:3, 3])]
        model.images += [
            f"{first_image + k} {' '.join(map(repr, map(float, placed)))} {number} {name}",
            " ".join(
                f"{float(x)!r} {float(y) + 0.5!r} {first_point + n}"
                for n, (x, y) in enumerate(zip(where[eye], rows, strict=True))
            ),
        ]
        model.frames.append(_make_frame(f"images/{name}", camera, pose))
    for n, point in enumerate(points):
        blue, green, red = np.broadcast_to(seen["left"][rows[n], columns[n]], 3).tolist()
        place = " ".join(map(repr, map(float, point)))
        model.points.append(f"{first_point + n} {place} {red} {green} {blue} 0 {first_image} {n} {first_image + 1} {n}")


def _choose_pixels(pair: LoadedPair) -> tuple[Array, Array, Array]:
    """Choose left pixels that both eyes see, evenly spread.

    Return their rows and columns, and the columns of their points in the right image.
    """
    rows, columns = np.nonzero(pair.visible["left"])
    step = max(1, len(rows) // _POINTS_PER_PAIR)
    rows, columns = rows[::step], columns[::step]
    disparity = pair.pair.camera.disparity(pair.depth["left"][rows, columns])
    return rows, columns, columns + 0.5 - disparity


def _find_world_points(pair: LoadedPair, rows: Array, columns: Array) -> Array:
    """Find the world coordinates (n, 3), m, of the points at left pixels."""
    pose = read_pose(pair, "left")
    eye = make_pixel_rays(pair.pair.camera)[rows, columns] * pair.depth["left"][rows, columns, None]
    return eye @ pose[:3, :3].T + pose[:3, 3]


CAHVOR = Export(write_pair=_write_cahvor)
COLMAP = Export(write_all=_write_colmap)
