"""Recognises the layout of a data set's folder, and finds the files of its pairs.

| layout | known by |
|---|---|
| a plain folder | ``pairs.toml`` |
| KITTI 2015, 2012 and our export | ``image_2`` and ``disp_occ_0``; ``image_0`` or ``colored_0`` and ``disp_occ`` |
| Middlebury, ETH3D and our export | ``im0.png``, ``calib.txt`` and ``disp0GT.pfm`` or ``disp0.pfm`` in each folder |
| SceneFlow | ``disparity`` beside ``frames_cleanpass`` or ``frames_finalpass`` |
| Sintel | ``disparities`` beside ``clean_left`` or ``final_left`` |
| GUISS | ``NAME_left.png``, ``NAME_right.png`` and ``NAME_left.npy`` |
| our exports png16 and pfm | ``calibration.json`` in each folder |
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from ...physics.camera.stereo_camera import StereoCamera
from ...support.errors import IcyMoonError
from ...support.files import list_user_files
from . import calibrations
from .data_files import MapFile, resolve_inside
from .foreign_pair import CameraReader, ForeignPair, UnusablePair, make_safe_name, open_foreign_pair
from .plain_folder import PAIRS_FILE as PLAIN_FILE
from .plain_folder import find_plain_pairs
from .visibility import Mask

#: Focal lengths, px, of SceneFlow's cameras: the usual one, and the one for paths with 15mm. All cameras share the
#: principal point and the baseline of 1.
_SCENEFLOW_FOCAL_PX, _SCENEFLOW_SHORT_PX = 1050.0, 450.0
_SCENEFLOW_CENTRE, _SCENEFLOW_BASELINE = (479.5, 269.5), 1.0
_SINTEL_BASELINE_M = 0.1
#: f·B of GUISS' camera, 640·32/60·0.25 px·m: a lens of 32 mm, a sensor of 60 mm, and a baseline of 0.25 m.
_GUISS_FOCAL_SHARE, _GUISS_BASELINE_M = 32 / 60, 0.25
_KITTI_FRAME = re.compile(r"\d{6}_10\.png")

FoundPair = ForeignPair | UnusablePair
Finder = Callable[[Path], list[FoundPair]]


def find_foreign_pairs(path: Path) -> list[FoundPair]:
    """Find the pairs at ``path``, a folder in one of the layouts or of one pair; empty for any other path.

    A pair with a file that is missing or outside the folder is unusable; the others stay. Raises IcyMoonError if no
    pair is left, a folder that the layout needs is missing, or two pairs have the same name.
    """
    if not path.is_dir():
        return []
    found: list[FoundPair] = next(filter(None, (finder(path) for finder in LAYOUT_FINDERS)), [])
    unusable = [pair for pair in found if isinstance(pair, UnusablePair)]
    if found and len(unusable) == len(found):
        raise IcyMoonError(unusable[0].fault)
    names: dict[str, FoundPair] = {}
    for pair in found:
        other = names.setdefault(pair.name, pair)
        if other is not pair:
            raise IcyMoonError(
                f"{other.left} and {pair.left} would both be called {pair.name}; rename the "
                "files or the folder of one of them."
            )
    return found


def _find_kitti_2015(path: Path) -> list[FoundPair]:
    root = next((folder for folder in (path, path / "training") if (folder / "image_2").is_dir()), None)
    if root is None or not (root / "disp_occ_0").is_dir():
        return []
    return list(
        _find_kitti_pairs(
            root,
            "KITTI 2015",
            ("image_2", "image_3"),
            ("disp_occ_0", "disp_noc_0"),
            "calib_cam_to_cam",
            ("P_rect_02", "P_rect_03"),
        )
    )


def _find_kitti_2012(path: Path) -> list[FoundPair]:
    for folder in (path, path / "training"):
        if not (folder / "disp_occ").is_dir():
            continue
        for eyes, matrices in ((("colored_0", "colored_1"), ("P2", "P3")), (("image_0", "image_1"), ("P0", "P1"))):
            if (folder / eyes[0]).is_dir():
                return list(_find_kitti_pairs(folder, "KITTI 2012", eyes, ("disp_occ", "disp_noc"), "calib", matrices))
    return []


def _find_kitti_pairs(
    root: Path, layout: str, eyes: tuple[str, str], truths: tuple[str, str], calibration: str, matrices: tuple[str, str]
) -> Iterator[FoundPair]:
    for image in list_user_files(root / eyes[0], "*_10.png"):
        if _KITTI_FRAME.fullmatch(image.name):
            yield open_foreign_pair(
                image.stem,
                root,
                image,
                partial(_make_kitti_pair, root, image, layout, eyes[1], truths, calibration, matrices),
            )


def _make_kitti_pair(
    root: Path,
    image: Path,
    layout: str,
    right: str,
    truths: tuple[str, str],
    calibration: str,
    matrices: tuple[str, str],
) -> ForeignPair:
    camera = resolve_inside(root, Path(calibration, f"{image.name[:6]}.txt"))
    nocc = root / truths[1] / image.name
    return ForeignPair(
        image.stem,
        root,
        layout,
        image.stem,
        resolve_inside(root, image.relative_to(root)),
        resolve_inside(root, Path(right, image.name)),
        MapFile(resolve_inside(root, Path(truths[0], image.name))),
        partial(calibrations.read_kitti_camera, camera, matrices),
        (camera,),
        mask=Mask("known", (resolve_inside(root, Path(truths[1], image.name)),)) if nocc.exists() else None,
    )


def _find_middlebury(path: Path) -> list[FoundPair]:
    return [
        open_foreign_pair(
            _folder_name(path, folder), folder, folder / "im0.png", partial(_make_middlebury_pair, path, folder)
        )
        for folder in _find_folders_with(path, "im0.png")
    ]


def _find_folders_with(path: Path, name: str) -> list[Path]:
    """Return the folder itself if it contains a file of this name, else its subfolders that do."""
    if (path / name).is_file():
        return [path]
    return [file.parent for file in list_user_files(path, f"*/{name}")]


def _folder_name(root: Path, folder: Path) -> str:
    """Name the pair in a folder; ``root`` may be written as ``.``."""
    return make_safe_name((folder.resolve() if folder == root else folder).name)


def _make_middlebury_pair(root: Path, folder: Path) -> ForeignPair:
    left = resolve_inside(root, folder.relative_to(root) / "im0.png")
    calibration = resolve_inside(root, folder.relative_to(root) / "calib.txt")
    official = (folder / "disp0GT.pfm").exists()
    right = "disp1GT.pfm" if official else "disp1.pfm"
    mask = folder / "mask0nocc.png"
    name = _folder_name(root, folder)
    return ForeignPair(
        name,
        folder,
        "Middlebury",
        name,
        left,
        resolve_inside(folder, "im1.png"),
        MapFile(resolve_inside(folder, "disp0GT.pfm" if official else "disp0.pfm")),
        partial(calibrations.read_middlebury_camera, calibration),
        (calibration,),
        MapFile(resolve_inside(folder, right)) if (folder / right).exists() else None,
        Mask("seen", (resolve_inside(folder, mask.name),)) if mask.exists() else None,
        row_offset_reader=partial(calibrations.read_row_offset_px, calibration),
        disparities_reader=partial(calibrations.read_disparity_count, calibration),
    )


def _find_sceneflow(path: Path) -> list[FoundPair]:
    root, passes = _find_root(path, ("frames_cleanpass", "frames_finalpass"))
    if not passes or not (root / "disparity").is_dir():
        return []
    # The images are PNG or WebP.
    images = next(
        filter(None, (list_user_files(root / passes[0], f"**/left/*.{kind}") for kind in ("png", "webp"))), []
    )
    found = []
    for image in images:
        inner = image.relative_to(root / passes[0])
        name = make_safe_name("-".join((*inner.parent.parent.parts, inner.stem)))
        found.append(open_foreign_pair(name, root, image, partial(_make_sceneflow_pair, root, passes[0], inner, name)))
    return found


def _make_sceneflow_pair(root: Path, rendering: str, inner: Path, name: str) -> ForeignPair:
    scene = inner.parent.parent
    other = scene / "right" / inner.name
    truth, truth_right = (Path("disparity", part).with_suffix(".pfm") for part in (inner, other))
    focal = _SCENEFLOW_SHORT_PX if any(part.startswith("15mm") for part in inner.parts) else _SCENEFLOW_FOCAL_PX
    return ForeignPair(
        name,
        root,
        "SceneFlow",
        "-".join(scene.parts),
        resolve_inside(root, Path(rendering) / inner),
        resolve_inside(root, Path(rendering) / other),
        MapFile(resolve_inside(root, truth)),
        partial(calibrations.make_common_camera, focal, *_SCENEFLOW_CENTRE, _SCENEFLOW_BASELINE),
        truth_right=MapFile(resolve_inside(root, truth_right)) if (root / truth_right).exists() else None,
        either_sign=True,
        notes=("The unit of length of SceneFlow is not the metre: its baseline is 1.",),
    )


def _find_root(path: Path, passes: tuple[str, ...]) -> tuple[Path, list[str]]:
    """Return the root of a data set with several renderings of its images, and its renderings.

    If ``path`` is one of the renderings, only its own name is returned with the root.
    """
    if path.name in passes:
        return path.parent, [path.name]
    root = next(
        (folder for folder in (path, path / "training") if any((folder / name).is_dir() for name in passes)), path
    )
    return root, [name for name in passes if (root / name).is_dir()]


def _find_sintel(path: Path) -> list[FoundPair]:
    root, passes = _find_root(path, ("clean_left", "final_left"))
    if not passes or not (root / "disparities").is_dir():
        return []
    if not (root / "camdata_left").is_dir():
        raise IcyMoonError(
            f"{root / 'camdata_left'} is missing, and without its focal lengths disparities give no "
            "depths; add this folder of Sintel's depth data."
        )
    found = []
    for image in list_user_files(root / passes[0], "*/*.png"):
        inner = image.relative_to(root / passes[0])
        name = make_safe_name("-".join((inner.parent.name, inner.stem)))
        found.append(open_foreign_pair(name, root, image, partial(_make_sintel_pair, root, passes[0], inner, name)))
    return found


def _make_sintel_pair(root: Path, rendering: str, inner: Path, name: str) -> ForeignPair:
    camera = Path("camdata_left", inner).with_suffix(".cam")
    masks = [Path(folder, inner) for folder in ("occlusions", "outofframe") if (root / folder / inner).exists()]
    calibration = resolve_inside(root, camera)
    return ForeignPair(
        name,
        root,
        "Sintel",
        inner.parent.name,
        resolve_inside(root, Path(rendering) / inner),
        resolve_inside(root, Path(rendering.replace("left", "right")) / inner),
        MapFile(resolve_inside(root, Path("disparities") / inner), sintel=True),
        partial(calibrations.read_sintel_camera, calibration, _SINTEL_BASELINE_M),
        (calibration,),
        mask=Mask("hidden", tuple(resolve_inside(root, each) for each in masks)) if masks else None,
    )


def _find_guiss(path: Path) -> list[FoundPair]:
    found = []
    for depth in sorted((*list_user_files(path, "*_left.npy"), *list_user_files(path, "*/*_left.npy"))):
        left, right = (depth.with_name(depth.name.replace("_left.npy", f"_{eye}.png")) for eye in ("left", "right"))
        if not left.exists():
            continue
        inner = depth.relative_to(path)
        name = make_safe_name("-".join((*inner.parent.parts, inner.name.removesuffix("_left.npy"))))
        found.append(open_foreign_pair(name, path, left, partial(_make_guiss_pair, path, inner, left, right, name)))
    return found


def _make_guiss_pair(root: Path, depth: Path, left: Path, right: Path, name: str) -> ForeignPair:
    return ForeignPair(
        name,
        root,
        "GUISS",
        "-".join(depth.parent.parts) or depth.name,
        resolve_inside(root, left.relative_to(root)),
        resolve_inside(root, right.relative_to(root)),
        MapFile(resolve_inside(root, depth), "depth"),
        _make_guiss_camera,
    )


def _make_guiss_camera(width: int, height: int) -> StereoCamera:
    return calibrations.make_centred_camera(_GUISS_FOCAL_SHARE * width, _GUISS_BASELINE_M, width, height)


def _find_our_exports(path: Path) -> list[FoundPair]:
    return [
        open_foreign_pair(
            _folder_name(path, folder), folder, folder / "left.png", partial(_make_our_export_pair, path, folder)
        )
        for folder in _find_folders_with(path, "calibration.json")
    ]


def _make_our_export_pair(root: Path, folder: Path) -> ForeignPair:
    calibration = resolve_inside(root, folder.relative_to(root) / "calibration.json")
    if (folder / "extrinsics.yml").exists():
        raise IcyMoonError(
            f"{folder} was exported with --format raw, which is not rectified; export it as png16, "
            "pfm, kitti or middlebury."
        )
    kind = "pfm" if (folder / "left.pfm").exists() else "png"
    if not (folder / f"disparity_left.{kind}").exists():
        raise IcyMoonError(
            f"{folder} has no disparity_left.{kind}, as png8 cannot hold it; export it as png16, "
            "pfm, kitti or middlebury."
        )
    name = _folder_name(root, folder)
    camera: CameraReader = partial(calibrations.read_exported_camera, calibration)
    return ForeignPair(
        name,
        folder,
        f"Our export {'pfm' if kind == 'pfm' else 'png16'}",
        name,
        resolve_inside(folder, f"left.{kind}"),
        resolve_inside(folder, f"right.{kind}"),
        MapFile(resolve_inside(folder, f"disparity_left.{kind}")),
        camera,
        (calibration,),
        MapFile(resolve_inside(folder, f"disparity_right.{kind}")),
        white=calibrations.read_saturation_radiance(calibration) if kind == "pfm" else None,
        linear=True,
    )


LAYOUT_FINDERS: tuple[Finder, ...] = (
    find_plain_pairs,
    _find_kitti_2015,
    _find_kitti_2012,
    _find_middlebury,
    _find_sceneflow,
    _find_sintel,
    _find_our_exports,
    _find_guiss,
)
#: The supported layouts, in words.
KNOWN_LAYOUTS = (
    f"KITTI 2012 or 2015, Middlebury, ETH3D, SceneFlow, Sintel, GUISS, our own exports, or a folder with {PLAIN_FILE}"
)
