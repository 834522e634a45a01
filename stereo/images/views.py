"""Read the images and the truth of a pair, as the cameras took them and on the parallel rig."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from ...render.pairs.pair_folder import Pair
from ...settings.topics.camera import RigSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.labels import GROUP_PASSES
from . import exr
from .disparity_and_occlusion import find_scene_depth
from .exr import Light, Truth, View, read_light, read_truth, read_view
from .lens import make_lens

_Images = TypeVar("_Images", Light, Truth, View)


def read_eye(pair: Pair, eye: str, without: Collection[str] = ()) -> tuple[Light, View]:
    """Read the light at an eye, with margins and toe-in, and light and truth on the parallel rig.

    Passes that are not needed may be left out, see ``exr.read_view``.

    Raises IcyMoonError with the name of the file if it is damaged or of another size than its camera.
    """
    image, truth = pair.image(eye), pair.truth(eye)
    if image == truth:
        view = read_view(image, eye, without)
        _check_size(image, view.depth, pair.camera.rendered_px)
        return view, _crop_margins(view, pair)
    light = read_light(image, eye, groups=not set(GROUP_PASSES) <= set(without))
    real = read_truth(truth, eye, without)
    _check_size(image, light.radiance, pair.camera.light_px)
    _check_size(truth, real.depth, pair.camera.rendered_px)
    real = _crop_margins(real, pair)
    return light, exr.join_light_and_truth(exr.Light(*_turn_light_to_parallel(light, pair, eye)), real)


def read_baked_error(pair: Pair, eye: str) -> dict[str, Array]:
    """Read a random error of an eye's baked light, as large as the actual one, by light group: float64 (H, W) on the
    parallel rig, in W/(m² sr), the mean of the bands. {} if no error is stored.

    Raises IcyMoonError with the name of the file if it is damaged or of another size than its camera.
    """
    path = pair.image(eye)
    found = exr.read_baked_error(path, eye)
    for error in found.values():
        _check_size(path, error, pair.camera.light_px)
    turn = _turn_to_parallel(pair, eye)
    return {group: turn(error) for group, error in found.items()}


def read_sensor_depth(pair: Pair, eye: str, rig: RigSettings) -> Array:
    """Read the depth at the pixels of an eye's sensor, along the eye's own axis: metres, float32 (H, W), NaN for
    none."""
    if pair.camera.eyes is not None:
        return find_scene_depth(read_sensor_truth(pair, eye)).astype(np.float32)
    path = pair.truth_of_image(eye)
    depth = find_scene_depth(read_truth(path, eye))
    _check_size(path, depth, pair.camera.rendered_px)
    lens = make_lens(pair.camera, rig, eye)
    seen = pair.camera.cropped(depth) if lens is None else lens.depth_of_sensor(depth)
    return np.asarray(seen.astype(np.float32))


def read_sensor_truth(pair: Pair, eye: str) -> Truth:
    """Read the truth at the pixels of a calibrated eye's sensor, found by its own rays; depth along the eye's own axis.

    Raises IcyMoonError with the name of the file if it is damaged or of another size than the sensor.
    """
    path = pair.truth_of_sensor(eye)
    truth = read_truth(path, eye)
    _check_size(path, truth.depth, pair.camera.sensor_px(eye))
    return truth


def _turn_light_to_parallel(light: Light, pair: Pair, eye: str) -> tuple[Array, dict[str, Array]]:
    turn = _turn_to_parallel(pair, eye)
    return turn(light.radiance), {group: turn(radiance) for group, radiance in light.groups.items()}


def _turn_to_parallel(pair: Pair, eye: str) -> Callable[[Array], Array]:
    """Make a function that resamples an image of an eye's rendered pixels to the parallel rig."""
    plain = RigSettings.from_values({f"distortion_{name}": 0.0 for name in ("k1", "k2", "p1", "p2", "k3")})
    camera = pair.camera if pair.camera.panorama else replace(pair.camera, eyes=None)
    lens = make_lens(camera, plain, eye)
    return pair.camera.cropped if lens is None else lens.rectify_radiance


def _crop_margins(images: _Images, pair: Pair) -> _Images:
    """Crop all arrays of ``images`` to the image without margins."""

    def crop(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: crop(each) for key, each in value.items()}
        return value if value is None else pair.camera.cropped(value)

    return replace(images, **{field.name: crop(getattr(images, field.name)) for field in fields(images)})


def _check_size(path: object, image: Array, size_px: tuple[int, int]) -> None:
    height, width = image.shape[:2]
    if (width, height) != size_px:
        raise IcyMoonError(
            f"{path} is {width} x {height} px, but its camera has {size_px[0]} x {size_px[1]} px; render the pair "
            "again."
        )
