"""Pairs as training samples: a data set for PyTorch's ``DataLoader`` that develops them on the fly.

A sample depends on its number, the epoch and the seed alone, so it is the same in any worker and for any number of
workers. PyTorch is imported when the first sample is made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..physics.camera.sensor import find_stream
from ..physics.random_numbers.seeds import make_generator
from ..render.pairs.pair_folder import EYES, Pair, find_pairs
from ..render.pairs.scene_splits import check_splits, choose_split, name_scene, read_splits
from ..settings.description import check, merged
from ..settings.preset_files import load_preset
from ..settings.table import TOPICS
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from .fusion.range_points import make_point_generator, make_range_points, mark_pixels
from .images.crops import Crop, Crops, read_whole
from .images.head_views import develop_head_view, read_head_view
from .learning import CROP_PX
from .learning.tensors import require_torch, to_tensors
from .matchers.lidar_options import LIDAR, complete_lidar_options

if TYPE_CHECKING:
    from .learning.sample_stream import SampleStream


class Dataset:
    """The pairs of data sets, developed on demand. Works with ``DataLoader``.

    A sample is a dictionary of tensors: ``left`` and ``right``, float32 (1, H, W), or (3, H, W) of a colour sensor,
    from 0 to 1; ``disparity_px``, float32 (H, W), 0 where unknown; ``valid``, bool (H, W), where it is known;
    ``occluded``, bool (H, W), where the right eye does not see its point; ``focal_px``, ``baseline_m``, ``cx_px`` and
    ``cy_px`` of the crop; and the texts ``pair`` and ``scene``. With ``lidar``, such as {"points": 300}, also
    ``range_disparity_px``, float32 (H, W): the disparities of range points at their nearest pixels, 0 elsewhere. Its
    options are as in the method ``lidar``; the points and their noise are drawn anew in every epoch, and "returns"
    names the folder of a scan by ``icymoon lidar``.

    ``split`` is one of ``splits``, the shares of the scenes. Their default is in the plan of the data set, or 80 %
    train, 10 % val and 10 % test. Pairs of one ground are never in two splits. ``presets`` and ``augment`` change the
    camera response: ``augment={"sensor.read_noise_e": (2, 40)}`` draws each setting from a range, anew for every
    sample and epoch. ``crop_px`` is (width, height) of a random window. Raises IcyMoonError for an unknown split,
    for settings that need a new render, and if no pair is left.
    """

    def __init__(
        self,
        paths: str | Path | Sequence[str | Path],
        split: str | None = None,
        *,
        splits: Mapping[str, float] | None = None,
        presets: Sequence[str] = (),
        augment: Mapping[str, tuple[float, float]] | None = None,
        crop_px: tuple[int, int] | None = None,
        seed: int = 0,
        lidar: Mapping[str, Any] | None = None,
    ) -> None:
        self._lidar = None if lidar is None else complete_lidar_options(LIDAR, lidar)
        self.pairs = _choose_pairs(paths, split, splits)
        for pair in self.pairs:
            pair.image("left")  # raises for a pair that has no eyes
        self._response = merged(*(load_preset(name) for name in presets))
        self._ranges = dict(augment or {})
        self._crop, self._seed, self._epoch = crop_px, seed, 0
        self._crops = Crops()
        for name, (low, high) in self._ranges.items():
            for value in (low, high):
                _make_setting(name, value)
        _refuse_renders(self._response)
        if crop_px:
            self._check_crop(crop_px)

    def _check_crop(self, crop_px: tuple[int, int]) -> None:
        for pair in self.pairs:
            if crop_px[0] > pair.camera.width_px or crop_px[1] > pair.camera.height_px or min(crop_px) < 1:
                raise IcyMoonError(
                    f"{pair.folder} has {pair.camera.width_px} x {pair.camera.height_px} pixels, and "
                    f"crop_px is {crop_px[0]} x {crop_px[1]}; give a smaller one."
                )

    def __repr__(self) -> str:
        scenes = len({name_scene(pair) for pair in self.pairs})
        return f"<Dataset of {format_count(len(self), 'pair')} of {format_count(scenes, 'scene')}>"

    def __len__(self) -> int:
        return len(self.pairs)

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of crops, noise and augmentation; call it before a ``DataLoader`` starts its workers."""
        self._epoch = epoch

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Return the sample with this number, the same for the same seed and epoch. Raises IcyMoonError without
        PyTorch.
        """
        return to_tensors(self.arrays(range(len(self.pairs))[number]))

    def arrays(self, number: int) -> dict[str, Any]:
        """Return the sample as NumPy arrays."""
        pair = self.pairs[number]
        random = make_generator(self._seed, "training", self._epoch, int(pair.id, 16))
        drawn = {name: float(random.uniform(low, high)) for name, (low, high) in self._ranges.items()}
        settings = merged(
            pair.settings,
            self._response,
            *(_make_setting(name, value) for name, value in drawn.items()),
            {"sensor": {"noise_seed": int(random.integers(2**31 - 1))}},
        )
        rows, columns, left, upper = self._draw_window(pair, random)
        crop = Crop(rows, columns)
        # Range points are drawn in the whole image, so it is read without a crop.
        shown = self._crops.read(pair, settings, crop) if self._crop and self._lidar is None else None
        if shown is None:
            whole = read_whole(pair, settings)
            if self._lidar is not None:
                whole["range_disparity_px"] = self._mark_range_points(pair, whole, self._lidar)
            shown = {key: value[rows, columns] for key, value in whole.items()}
        for eye in EYES:
            grey = shown[eye].ndim == 2
            shown[eye] = (shown[eye][None] if grey else np.moveaxis(shown[eye], -1, 0)).astype(np.float32)
        shown["disparity_px"] = shown["disparity_px"].astype(np.float32)
        return {
            **shown,
            "focal_px": pair.camera.focal_px,
            "baseline_m": pair.camera.baseline_m,
            "cx_px": pair.camera.cx_px - left,
            "cy_px": pair.camera.cy_px - upper,
            "pair": pair.id,
            "scene": name_scene(pair),
        }

    def _mark_range_points(self, pair: Pair, whole: Mapping[str, Any], options: Mapping[str, Any]) -> Array:
        """Return the disparities (H, W), px, of the range points of a pair in this epoch."""
        truth = np.where(whole["valid"], pair.camera.depth(whole["disparity_px"]), np.nan)
        random = make_point_generator(options["seed"], pair.name, self._epoch)
        return mark_pixels(make_range_points(options, pair, truth, pair.camera, random), truth.shape)

    def _draw_window(self, pair: Pair, random: np.random.Generator) -> tuple[slice, slice, int, int]:
        """Draw the rows and columns of the crop, and its corner. Both eyes have the same columns, so
        disparities stay.
        """
        width, height = self._crop or (pair.camera.width_px, pair.camera.height_px)
        left = int(random.integers(pair.camera.width_px - width + 1))
        upper = int(random.integers(pair.camera.height_px - height + 1))
        return slice(upper, upper + height), slice(left, left + width), left, upper


class Cameras:
    """The cameras beside the pairs of data sets, for networks with a single input image; works with ``DataLoader``.

    A sample is a dictionary of tensors: ``image``, float32 (1, H, W), or (3, H, W) of a colour sensor, from 0 to 1;
    ``distance_m`` along the rays and ``depth_m`` along the optical axis, float32 (H, W), 0 where unknown; ``valid``,
    bool (H, W), where they are known; ``semantic``, int64 (H, W), and ``normal``, float32 (3, H, W) in the world's
    axes, if the pairs have them; ``pose``, float64 (4, 4), from the camera to the world; and the texts ``camera``,
    ``role``, ``model``, ``pair`` and ``scene``.

    ``cameras`` and ``roles`` choose cameras by name and by role; without both, all cameras are chosen. Only images of
    one size fit into a batch. For the other parameters see ``Dataset``. Raises IcyMoonError if no camera is left.
    """

    def __init__(
        self,
        paths: str | Path | Sequence[str | Path],
        split: str | None = None,
        *,
        splits: Mapping[str, float] | None = None,
        cameras: Sequence[str] = (),
        roles: Sequence[str] = (),
        presets: Sequence[str] = (),
        seed: int = 0,
    ) -> None:
        found = _choose_pairs(paths, split, splits)
        self.samples = [
            (pair, camera)
            for pair in found
            for camera in pair.head
            if (not cameras or camera.name in cameras) and (not roles or camera.role in roles)
        ]
        if not self.samples:
            there = sorted({f"{camera.name} ({camera.role})" for pair in found for camera in pair.head})
            raise IcyMoonError(
                f"The pairs have no such camera beside them; there are "
                f"{', '.join(there) or 'none, so state rig.head_file'}."
            )
        self._response = merged(*(load_preset(name) for name in presets))
        _refuse_renders(self._response)
        self._seed, self._epoch = seed, 0

    def __len__(self) -> int:
        return len(self.samples)

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of the noise; call it before a ``DataLoader`` starts its workers."""
        self._epoch = epoch

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Return the sample with this number, the same for the same seed and epoch. Raises IcyMoonError without
        PyTorch.
        """
        return to_tensors(self.arrays(range(len(self.samples))[number]))

    def arrays(self, number: int) -> dict[str, Any]:
        """Return the sample as NumPy arrays."""
        pair, camera = self.samples[number]
        random = make_generator(self._seed, "training", self._epoch, int(pair.id, 16), find_stream(camera.name))
        settings = merged(pair.settings, self._response, {"sensor": {"noise_seed": int(random.integers(2**31 - 1))}})
        view = read_head_view(pair, camera)
        image = develop_head_view(pair, view, settings)
        seen = image.grey[None] if image.colour is None else np.moveaxis(image.colour, -1, 0)
        found: dict[str, Any] = {
            "image": (seen / (2.0**image.bits - 1)).astype(np.float32),
            "distance_m": np.nan_to_num(view.distance_m).astype(np.float32),
            "depth_m": np.nan_to_num(view.depth_m).astype(np.float32),
            "valid": np.isfinite(view.distance_m),
            "pose": camera.pose,
            "camera": camera.name,
            "role": camera.role,
            "model": camera.model,
            "pair": pair.id,
            "scene": name_scene(pair),
        }
        if view.semantic is not None:
            found["semantic"] = view.semantic.astype(np.int64)
        if view.normal is not None:
            found["normal"] = np.moveaxis(view.normal, -1, 0).astype(np.float32)
        return found


def stream_made_pairs(
    split: str = "train", *, seed: int = 0, crop_px: tuple[int, int] = CROP_PX, first_ground: int = 0
) -> SampleStream:
    """Make an endless ``IterableDataset`` of ray-traced pairs, without Blender.

    A sample has the keys of a sample of ``Dataset``: ``left``, ``right``, ``disparity_px``, ``valid``, ``occluded``,
    the camera, and the texts ``pair`` and ``scene``. Sample n of a split and seed is the same in any worker and for any
    number of workers. ``split`` is "train"; "ground" for new grounds of the same kinds; or "landform", "body" or "sun"
    for kinds that training never shows. ``crop_px`` is (width, height), multiples of 8. Raises IcyMoonError for other
    values, without PyTorch, and without Embree.
    """
    require_torch()
    # Imported here, because they need OpenCV, and samples of rendered pairs do not.
    from .learning.made_pairs import MadePairs
    from .learning.sample_stream import SampleStream

    return SampleStream(MadePairs(split, seed, crop_px), first_ground)


def _choose_pairs(
    paths: str | Path | Sequence[str | Path], split: str | None, splits: Mapping[str, float] | None
) -> list[Pair]:
    """Choose the pairs of data sets that are in a split, or all pairs. Raises IcyMoonError for an unknown split, and if
    no pair is left.
    """
    stated = None if splits is None else check_splits(splits)
    roots = [paths] if isinstance(paths, str | Path) else list(paths)
    found = [pair for root in roots for pair in find_pairs(Path(root))]
    sets = {pair.folder.parent.parent for pair in found}
    shares = {dataset: read_splits(dataset) if stated is None else stated for dataset in sets}
    known = list(dict.fromkeys(name for each in shares.values() for name in each))
    if split is not None and split not in known:
        raise IcyMoonError(f"There is no split {split!r}; there are {', '.join(known)}.")
    chosen = [
        pair
        for pair in found
        if split is None or choose_split(name_scene(pair), shares[pair.folder.parent.parent]) == split
    ]
    if not chosen:
        raise IcyMoonError(
            f"None of the {format_count(len(found), 'pair')} is in the split {split}; give more "
            "scenes, or other splits."
        )
    return chosen


def _make_setting(name: str, value: float) -> Settings:
    """Make a partial description with one setting that needs no new render. Raises IcyMoonError for any other
    setting.
    """
    topic, _, key = name.partition(".")
    whole = topic in TOPICS and any(s.key == key and s.kind == "int" for s in TOPICS[topic].settings)
    found = check({topic: {key: round(value) if whole else float(value)}}, "augment")
    _refuse_renders(found)
    return found


def _refuse_renders(settings: Settings) -> None:
    for topic, values in settings.items():
        for key in values:
            if TOPICS[topic][key].effect not in ("response", "run"):
                raise IcyMoonError(f"{topic}.{key} needs a new render; vary it in a plan, and augment sensor settings.")
