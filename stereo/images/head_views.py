"""Read and develop the images of the cameras beside a pair, and read their truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...physics.camera import exposure_brackets
from ...physics.camera.colour import mix_to_grey
from ...physics.camera.deposits import apply_deposits, compute_blocked_share
from ...physics.camera.head_camera import HeadCamera, is_plain, make_rays_of_pixels, show_points
from ...physics.camera.point_spread import apply_point_spread
from ...physics.camera.sensor import black_dn, choose_exposure_s
from ...physics.light.photons import pixel_pitch_m
from ...render.pairs.head_files import image_file, truth_file
from ...render.pairs.pair_folder import Pair
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from . import exr
from .develop import Channels, expose_eye, merge_frames, scale_radiance
from .disparity_and_occlusion import find_scene_depth
from .exr import Light
from .lens import make_pixel_grid
from .spline import sample


@dataclass(frozen=True)
class HeadView:
    """The light and the truth of a camera beside a pair, on its own pixels.

    ``distance_m`` float64 (H, W) is along the rays, NaN for sky and the planet; ``normal`` (H, W, 3), ``instance`` and
    ``semantic`` (H, W) are as in ``exr.Truth``.
    """

    camera: HeadCamera
    light: Light
    distance_m: Array
    normal: Array | None
    instance: Array | None
    semantic: Array | None

    @property
    def depth_m(self) -> Array:
        """Depth along the optical axis, m, float64 (H, W); negative for points behind a camera with a wide field."""
        return self.distance_m * _make_camera_rays(self.camera)[1][..., 2]

    @property
    def points_m(self) -> Array:
        """Points at the pixels, m, in the world's axes, float64 (H, W, 3)."""
        origins, directions = _make_camera_rays(self.camera)
        own = origins + directions * self.distance_m[..., None]
        return np.asarray(own @ self.camera.rotation.T + self.camera.position_m)


@dataclass(frozen=True)
class HeadImage:
    """The developed image of a camera: grey digital numbers, uint16 (H, W), of ``bits`` bits. A colour sensor also
    gives ``colour`` (H, W, 3), R, G, B.
    """

    grey: Array
    bits: int
    exposure_s: float
    colour: Array | None = None

    def for_files(self) -> Array:
        """Return the grey image, or the colours in the order B, G, R, in which OpenCV writes them."""
        return self.grey if self.colour is None else self.colour[..., ::-1]


def _make_camera_rays(camera: HeadCamera) -> tuple[Array, Array]:
    return make_rays_of_pixels(camera.projection, make_pixel_grid(*camera.projection.size_px))


def read_head_views(pair: Pair) -> Iterator[HeadView]:
    """Yield the views of the cameras beside a pair, one after the other.

    Raises IcyMoonError with the name of the file if it is damaged or of another size than its camera.
    """
    for camera in pair.head:
        yield read_head_view(pair, camera)


def read_head_view(pair: Pair, camera: HeadCamera) -> HeadView:
    """Read the view of one camera beside the pair, see ``read_head_views``."""
    image = pair.folder / image_file(camera.name)
    truth = image if is_plain(camera.projection) else pair.folder / truth_file(camera.name)
    light, seen = exr.read_light(image), exr.read_distances(truth)
    _check_size(image, light.radiance, camera.rendered.size_px)
    _check_size(truth, seen.depth, camera.projection.size_px)
    if image != truth:
        places = show_points(camera.rendered, _make_camera_rays(camera)[1])
        light = Light(_resample(light.radiance, places), {k: _resample(v, places) for k, v in light.groups.items()})
    return HeadView(camera, light, find_scene_depth(seen), seen.normal, seen.instance, seen.semantic)


def _resample(radiance: Array, places: Array) -> Array:
    """Resample radiance (H, W, bands) at positions of a rendered image, by splines; 0 outside the field of view."""
    bands = [np.maximum(np.nan_to_num(sample(band, places)), 0.0) for band in np.moveaxis(radiance, -1, 0)]
    return np.stack(bands, axis=-1).astype(np.float32)


def _check_size(path: Path, image: Array, size_px: tuple[int, int]) -> None:
    if image.shape[1::-1] != size_px:
        raise IcyMoonError(
            f"{path} has {image.shape[1]} x {image.shape[0]} pixels, and its camera {size_px[0]} x {size_px[1]}; "
            "render the pair again."
        )


def develop_head_view(pair: Pair, view: HeadView, settings: Settings) -> HeadImage:
    """Develop the image of a camera with the response of the pair's sensor, and with its own exposure and noise.

    The same pair, camera and seeds always give the same noise.
    """
    sensor, seed, name = settings.sensor, int(pair.settings.dataset.seed), f"camera {view.camera.name}"
    pitch_m = pixel_pitch_m(sensor, settings.rig)
    channels = Channels(settings.light, sensor, pitch_m)
    columns, rows = view.camera.projection.size_px
    blocked = compute_blocked_share(sensor, settings.rig, (rows, columns), seed, name)
    planes = [
        apply_point_spread(apply_deposits(plane, blocked, sensor), sensor)
        for plane in channels.planes(scale_radiance(view.light, pair, settings))
    ]
    light = channels.at_pixels(planes)
    metered = choose_exposure_s(channels.balanced(light), channels.rate, sensor)
    times = exposure_brackets.list_exposure_times(metered, sensor)
    exposed = {name: expose_eye(light, times, channels.rate, settings, (seed, pair.id, name), pitch_m)}
    bits, numbers, _ = merge_frames(exposed, times, channels, sensor)
    if sensor.colour != "BAYER":
        return HeadImage(numbers[name], bits, metered)
    colour = channels.colours(numbers[name], bits, black_dn(sensor) if len(times) == 1 else 0.0)
    return HeadImage(np.rint(mix_to_grey(colour, sensor)).astype(np.uint16), bits, metered, colour)
