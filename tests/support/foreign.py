"""Folders in the layouts of other data sets: a textured plane, shifted by a known disparity.

They are written by hand, from what the data sets state about themselves, not with what the evaluation reads or writes.
"""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
from icymoon.support.arrays import Array

WIDTH, HEIGHT, SHIFT_PX = 96, 64, 7


def eyes(shift: int = SHIFT_PX, colour: bool = False, seed: int = 1) -> tuple[Array, Array]:
    """Left and right image, uint8, of a plane that faces the camera: a point of the left column u is in u - shift."""
    noise = np.random.default_rng(seed).uniform(0, 255, (HEIGHT, WIDTH + shift)).astype(np.float32)
    texture = cv2.GaussianBlur(noise, (0, 0), 1.0)
    texture = np.clip(128 + 3 * (texture - texture.mean()), 0, 255).astype(np.uint8)
    left, right = texture[:, :WIDTH], texture[:, shift:]
    if colour:
        left, right = (np.stack([image, image // 2, 255 - image], axis=-1) for image in (left, right))
    return left, right


def constant(value: float = SHIFT_PX) -> Array:
    """A map with one value."""
    return np.full((HEIGHT, WIDTH), value, np.float32)


def write_image(path: Path, image: Array) -> Path:
    """Write an image in the format of its ending."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


def write_pfm(path: Path, values: Array) -> Path:
    """Write a map as PFM by its definition: bottom row first, little-endian."""
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = values.shape
    body = b"".join(struct.pack(f"<{width}f", *row) for row in values[::-1])
    path.write_bytes(b"Pf\n%d %d\n-1\n" % (width, height) + body)
    return path


def steps(values: Array, per_px: float = 256.0) -> Array:
    """Numbers of a 16-bit PNG, 0 where unknown."""
    return np.where(np.isfinite(values), np.round(values * per_px), 0).astype(np.uint16)


def kitti_2015(root: Path, frames: int = 1) -> Path:
    """``training`` as it is unpacked, f 700 px and B 0.5 m, with a row of unknown and a column of hidden pixels."""
    training = root / "training"
    truth = constant()
    truth[0] = np.nan
    seen = truth.copy()
    seen[:, :10] = np.nan
    for frame in range(frames):
        name = f"{frame:06d}_10.png"
        for folder, image in zip(("image_2", "image_3"), eyes(colour=True, seed=frame), strict=True):
            write_image(training / folder / name, image)
        write_image(training / "disp_occ_0" / name, steps(truth))
        write_image(training / "disp_noc_0" / name, steps(seen))
        calibration = training / "calib_cam_to_cam" / f"{frame:06d}.txt"
        calibration.parent.mkdir(exist_ok=True)
        calibration.write_text(
            "calib_time: 09-Jan-2012 13:57:47\n"
            "P_rect_02: 700 0 48 40 0 700 32 0.2 0 0 1 0.003\n"
            "P_rect_03: 700 0 48 -310 0 700 32 2.2 0 0 1 0.003\n",
            encoding="utf-8",
        )
    return root


def kitti_2012(root: Path) -> Path:
    """The grey images of 2012, whose second camera has -f·B in its matrix."""
    training = root / "training"
    for folder, image in zip(("image_0", "image_1"), eyes(), strict=True):
        write_image(training / folder / "000003_10.png", image)
        write_image(training / folder / "000003_11.png", image)  # the next frame, which has no truth
    for folder in ("disp_occ", "disp_noc"):
        write_image(training / folder / "000003_10.png", steps(constant()))
    (training / "calib").mkdir()
    (training / "calib" / "000003.txt").write_text(
        "P0: 700 0 48 0 0 700 32 0 0 0 1 0\nP1: 700 0 48 -350 0 700 32 0 0 0 1 0\n", encoding="utf-8"
    )
    return root


def middlebury(root: Path, official: bool = False, doffs: float = 20.0) -> Path:
    """A scene with f 100 px, B 200 mm and doffs: Z = 0.2·100 / (7 + doffs) m; a known pixel, infinity, has no truth."""
    scene = root / "Adirondack"
    for name, image in zip(("im0.png", "im1.png"), eyes(colour=True), strict=True):
        write_image(scene / name, image)
    truth = constant()
    truth[3, 5] = np.inf
    write_pfm(scene / ("disp0GT.pfm" if official else "disp0.pfm"), truth)
    if official:
        mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
        mask[3, 5], mask[:, :12] = 0, 128
        write_image(scene / "mask0nocc.png", mask)
        write_pfm(scene / "disp0MC-CNN.pfm", constant(3))  # somebody's result
    (scene / "calib.txt").write_text(
        f"cam0=[100 0 47.5; 0 100 31.5; 0 0 1]\ncam1=[100 0 {47.5 + doffs}; 0 100 31.5; 0 0 1]\ndoffs={doffs}\n"
        f"baseline=200\nwidth={WIDTH}\nheight={HEIGHT}\nndisp=60\nisint=0\nvmin=2\nvmax=55\ndyavg=0\ndymax=0\n",
        encoding="utf-8",
    )
    return root


def sceneflow(root: Path, negative: bool = False) -> Path:
    """Driving, 15 mm, and Monkaa, with positive or negative disparities."""
    for scene in ("15mm_focallength/scene_forwards/fast", "eating_camera2_x2"):
        for eye, image in zip(("left", "right"), eyes(colour=True), strict=True):
            write_image(root / "frames_finalpass" / scene / eye / "0001.png", image)
            write_pfm(root / "disparity" / scene / eye / "0001.pfm", constant(-SHIFT_PX if negative else SHIFT_PX))
    return root


def sintel(root: Path, camera: bool = True) -> Path:
    """A frame of Sintel; its bytes are R, G, B for 4 px, 1/64 px and 1/16384 px."""
    inner = Path("alley_1", "frame_0001.png")
    for folder, image in zip(("clean_left", "clean_right"), eyes(colour=True), strict=True):
        write_image(root / "training" / folder / inner, image)
    coded = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    coded[..., 2], coded[..., 1] = 1, 3 * 64  # 4 + 3 px
    write_image(root / "training" / "disparities" / inner, coded)
    hidden, outside = np.zeros((2, HEIGHT, WIDTH), np.uint8)
    hidden[:, 40:44] = outside[:, :SHIFT_PX] = 255
    write_image(root / "training" / "occlusions" / inner, hidden)
    write_image(root / "training" / "outofframe" / inner, outside)
    if camera:
        file = (root / "training" / "camdata_left" / inner).with_suffix(".cam")
        file.parent.mkdir(parents=True)
        file.write_bytes(struct.pack("<f21d", 202021.25, 700, 0, 47.5, 0, 700, 31.5, 0, 0, 1, *range(12)))
    return root


def guiss(root: Path) -> Path:
    """Their example: RGBA images and the depth of the left one; f·B is 96·32/60·0.25 px·m at this width."""
    for eye, image in zip(("left", "right"), eyes(), strict=True):
        opaque = np.stack([image, image, image, np.full_like(image, 255)], axis=-1)
        write_image(root / f"view_0000_{eye}.png", opaque)
    np.save(root / "view_0000_left.npy", constant(WIDTH * 32 / 60 * 0.25 / SHIFT_PX))
    write_image(root / "view_0000_left_depth.png", eyes()[0])  # a picture of it
    return root


def plain(root: Path, truth: str, toml: str = "", file: Array | None = None) -> Path:
    """A plain folder with f·B 70 px·m; ``truth`` is the table, ``file`` what ``truth/a.npy`` contains."""
    for eye, image in zip(("left", "right"), eyes(), strict=True):
        write_image(root / eye / "a.png", image)
    if file is not None:
        (root / "truth").mkdir()
        np.save(root / "truth" / "a.npy", file)
    (root / "pairs.toml").write_text(
        f'[images]\nleft = "left/{{pair}}.png"\nright = "right/{{pair}}.png"\n[truth]\n{truth}\n'
        f"[camera]\nfocal_px = 140\nbaseline_m = 0.5\n{toml}",
        encoding="utf-8",
    )
    return root
