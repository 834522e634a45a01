"""Images for surfaces: the user's own files, images of the mesh, and generated sets.

An image is loaded or generated once, and found again by its key.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ...formats.image_size import check_pixels, count_pixels
from ...formats.map_frame import MapFrame
from ...formats.map_image import read_map_image
from ...formats.mesh_images import MeshImage
from ...formats.tiff import stores_floats
from ...physics.mesh import texture_coordinates
from ...physics.rocks.painted_mask import read_mask
from ...physics.surfaces.textures import make_maps
from ...settings.topics.surfaces import TexturesSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import ForeignBytes, explain_errors, parse_json, parse_part, read
from ...support.labels import UV_LAYER
from ...support.srgb import from_srgb

#: Custom properties: the key of an image, and the mean of its linear values.
_KEY_PROPERTY, _MEAN_PROPERTY = "icymoon_key", "icymoon_mean"
#: Custom properties: the edges of an image on a map, and the parts of the ground that it lacks.
_PLACED_PROPERTY, _LACKS_PROPERTY = "icymoon_placed", "icymoon_lacks"
#: Custom properties: the mark of the part on the ground, and the mean of that part.
_SHOWN_PROPERTY, _SHOWN_MEAN_PROPERTY = "icymoon_shown", "icymoon_shown_mean"
#: Results of ``measure_brightness_percentiles`` by the key of the image. They are not stored with the image, because a
#: new property of an image would make its materials count as edited.
_measured_brightness: dict[str, Array] = {}
#: Values of an image that are processed at once, since a baked image may have 10⁹.
_VALUES_PER_STEP = 1 << 24
#: Maximum number of pixels of an image, unless its file is large: 8192 x 8192, the largest image in most collections.
_MAX_PIXELS = 2**26
_KIND_TEXT = "an image"


@dataclass(frozen=True)
class Map:
    """An image, the mean (3,) of its linear values, and the channel to use if the kind of image has one value."""

    image: bpy.types.Image
    mean: tuple[float, float, float]
    channel: int = 0


def load_maps(textures: TexturesSettings, files: Mapping[str, Path | MeshImage]) -> dict[str, Map]:
    """Load the maps of ``textures`` settings, by kind; empty without textures.

    ``files`` contains the images of the user or of the mesh, by kind. Images that are loaded already are used again.
    Raises IcyMoonError if an image cannot be read.
    """
    if textures.set == "NONE":
        return {}
    if textures.set == "OWN":
        if not files:
            raise IcyMoonError(
                "textures.set is OWN, but no image is named; name one, such as textures.albedo_file, or "
                "set textures.set to MESH for the images of the mesh."
            )
    elif textures.set not in ("MESH", "STAND_IN"):
        return {kind: _make_map(textures.set, kind) for kind in ("albedo", "roughness", "height")}
    return {
        kind: _load_map(
            kind,
            file if isinstance(file, MeshImage) else MeshImage(file),
            f"textures.{kind}_file"
            if textures.set == "OWN"
            else f"the {kind} image of the {'mesh' if textures.set == 'MESH' else 'stand-in'}",
        )
        for kind, file in files.items()
    }


def load_placed_map(
    path: Path, frame: MapFrame, size_m: float, seen_m: float = 0.0
) -> tuple[Map, tuple[float, float, float, float], list[str]]:
    """Load an image that lies over the ground of a site by its map coordinates, and beyond the ground as
    ``read_map_image`` states. Returns its map with the mean over the ground; its west and south edge, width and height
    in metres in the frame of the site; and sentences on its gaps. Raises IcyMoonError if the image is missing or not
    over the ground.
    """
    if not path.is_file():
        raise IcyMoonError(f"{path}: there is no such file; check textures.albedo_file.")
    state = path.stat()
    key = f"{path} {state.st_size} {state.st_mtime_ns} {frame} {size_m!r} {seen_m!r}"
    if (there := _find_map(key)) is not None:
        placed, sentences = there.image[_PLACED_PROPERTY], parse_json(there.image[_LACKS_PROPERTY])
        return there, (placed[0], placed[1], placed[2], placed[3]), sentences
    found = read_map_image(path, frame, size_m, seen_m)
    rows, columns = found.values.shape
    image = _pack_grey(path.name, np.maximum(found.values[::-1], 0.0))
    placed = (found.west_m, found.south_m, columns * found.pixel_m[0], rows * found.pixel_m[1])
    image[_PLACED_PROPERTY], image[_LACKS_PROPERTY] = placed, json.dumps(found.warnings)
    return _remember_map(key, image, np.full(3, found.mean)), placed, list(found.warnings)


def load_mask_image(path: Path) -> Map:
    """Load a painted mask as an image without colour conversion. Raises IcyMoonError if it cannot be read."""
    values = read_mask(path)
    key = f"mask {hashlib.sha256(values.tobytes()).hexdigest()} {values.shape}"
    if (there := _find_map(key)) is not None:
        return there
    return _remember_map(key, _pack_grey(path.name, values[::-1]), np.full(3, values.mean(dtype=np.float64)))


def _pack_grey(name: str, from_south: Array) -> bpy.types.Image:
    """Make an image of floats (rows, columns) with these linear values, row 0 southernmost."""
    rows, columns = from_south.shape
    image = bpy.data.images.new(name, columns, rows, float_buffer=True, is_data=True)
    pixels = np.ones((rows, columns, 4), np.float32)
    pixels[..., :3] = from_south[..., None]
    image.pixels.foreach_set(pixels.ravel())
    image.pack()  # otherwise it would not be saved with the file
    return image


def remove_unused_images() -> None:
    """Remove the images of textures that have no users."""
    unused = [image for image in bpy.data.images if _KEY_PROPERTY in image and image.users == 0]
    if unused:
        bpy.data.batch_remove(unused)


def reuse_images() -> None:
    """Use the first of several equal images of textures for all; objects from a file bring their own along."""
    first: dict[str, bpy.types.Image] = {}
    for image in [image for image in bpy.data.images if _KEY_PROPERTY in image]:
        kept = first.setdefault(image[_KEY_PROPERTY], image)
        if kept != image:
            image.user_remap(kept)
    remove_unused_images()


def measure_means(mesh: bpy.types.Mesh, found: Mapping[str, Map]) -> dict[str, Map]:
    """Measure the means of maps anew, over the parts of the images that are on the mesh by its UV coordinates. Return
    the maps.

    Less than half of a baked image may be on the surface, and the rest is often black.
    """
    positions, uv = (np.empty(size, np.float32) for size in (3 * len(mesh.vertices), 2 * len(mesh.loops)))
    mesh.attributes["position"].data.foreach_get("vector", positions)
    mesh.attributes[UV_LAYER].data.foreach_get("vector", uv)
    vertices = np.empty(len(mesh.loops), np.int32)
    mesh.attributes[".corner_vert"].data.foreach_get("value", vertices)
    corners = np.arange(len(vertices), dtype=np.int32)
    if len(vertices) != 3 * len(mesh.polygons):  # edited by hand; computing triangles takes four times as long
        mesh.calc_loop_triangles()
        corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("loops", corners)
    points, weight = texture_coordinates.sample_surface(
        positions.reshape(-1, 3), vertices[corners].reshape(-1, 3), uv.reshape(-1, 2)[corners].reshape(-1, 3, 2)
    )
    mark = hashlib.sha256(points.tobytes() + weight.tobytes()).hexdigest()
    for each in found.values():
        if each.image.get(_SHOWN_PROPERTY) != mark:
            pixels = _read_pixels(each.image)
            values = _to_linear(each.image, pixels[texture_coordinates.find_pixels(points, *pixels.shape[:2])])
            each.image[_SHOWN_PROPERTY], each.image[_SHOWN_MEAN_PROPERTY] = mark, (weight @ values).tolist()
    return {kind: replace(each, mean=tuple(each.image[_SHOWN_MEAN_PROPERTY])) for kind, each in found.items()}


def measure_brightness_percentiles(of: Map) -> Array:
    """Measure the percentiles 0, 1, ... 100 of the brightest band of an image's pixels, as linear values (101,)."""
    key = of.image[_KEY_PROPERTY]
    if key not in _measured_brightness:
        values = _to_linear(of.image, _read_pixels(of.image)).max(axis=-1)
        _measured_brightness[key] = np.percentile(values, np.arange(101))
    return _measured_brightness[key]


def _find_map(key: str) -> Map | None:
    """Find the map whose image has this ``key``; None if no image has it."""
    image = next((image for image in bpy.data.images if image.get(_KEY_PROPERTY) == key), None)
    return Map(image, tuple(image[_MEAN_PROPERTY])) if image else None


def _remember_map(key: str, image: bpy.types.Image, mean: Array) -> Map:
    """Store the ``key`` and the ``mean`` (3,) of its linear values with an image, and return the map of the image."""
    image[_KEY_PROPERTY], image[_MEAN_PROPERTY] = key, mean.tolist()
    return Map(image, tuple(mean.tolist()))


def _make_map(name: str, kind: str) -> Map:
    key = f"{name} {kind}"
    found = _find_map(key)
    if found is not None:
        return found
    values = getattr(make_maps(name), kind)
    # Summed pixel by pixel: another order changes the last bit, and with it the id of edited scenes.
    mean = np.repeat(values[..., None], 3, axis=-1).reshape(-1, 3).mean(axis=0, dtype=np.float64)
    return _remember_map(key, _pack_grey(f"Icy Moon {key.title()}", values), mean)


def _load_map(kind: str, source: MeshImage, name: str) -> Map:
    path = source.file
    if not path.is_file():
        raise IcyMoonError(f"{path}: there is no such file; check {name}.")
    state = path.stat()
    key = f"{path} {state.st_size} {state.st_mtime_ns} {source.place} {kind}"
    found = _find_map(key)
    if found is None:
        image = _load_image(source, name)
        # Blender assumes sRGB for floats in a TIFF, but programs write linear values.
        floats = path.suffix.lower() in (".tif", ".tiff") and stores_floats(path)
        if floats or (kind != "albedo" and not image.is_float):
            image.colorspace_settings.name = "Non-Color"
        try:
            found = _remember_map(key, image, _measure_mean(path, name, image))
        except IcyMoonError:
            bpy.data.images.remove(image)
            raise
    return replace(found, channel=source.channel)


def _load_image(source: MeshImage, name: str) -> bpy.types.Image:
    """Load an image from a file, or from bytes within a file. Raises IcyMoonError if it has no size that Blender may
    load."""
    fix = f"give a PNG, JPEG, TIFF or EXR as {name}"

    def check(foreign: ForeignBytes) -> None:
        check_pixels(foreign, count_pixels(foreign), _MAX_PIXELS, f"make it smaller, or {fix}")

    path = source.file
    if source.data:
        data = source.data()
        parse_part(data, path, check, _KIND_TEXT, fix)
        return _unpack_image(source, data)
    read(path, check, _KIND_TEXT, fix)
    with explain_errors(path, _KIND_TEXT, fix):
        return bpy.data.images.load(str(path), check_existing=False)


def _unpack_image(source: MeshImage, data: bytes) -> bpy.types.Image:
    """Make an image from bytes within a file, packed into the .blend."""
    image = bpy.data.images.new(f"{source.file.name} {source.place}", 1, 1)
    image.pack(data=data, data_len=len(data))
    image.source = "FILE"
    return image


def _measure_mean(path: Path, name: str, image: bpy.types.Image) -> Array:
    """Measure the mean (3,) of an image's linear values. Raises IcyMoonError if it has no pixels or if values are not
    finite."""
    if image.size[0] * image.size[1] == 0:
        raise IcyMoonError(f"{path}: is not an image that can be read; give a PNG, JPEG, TIFF or EXR as {name}.")
    pixels, total = _read_pixels(image), np.zeros(3)
    for some in np.array_split(pixels, 1 + pixels.size // _VALUES_PER_STEP):
        values = _to_linear(image, some)
        if not np.isfinite(values).all():
            raise IcyMoonError(f"{path}: has pixels that are not numbers; fix the image or choose another for {name}.")
        total += values.sum(axis=(0, 1), dtype=np.float64)
    return total / (pixels.shape[0] * pixels.shape[1])


def _read_pixels(image: bpy.types.Image) -> Array:
    """Read the stored pixels (rows, columns, channels) of an image, with row 0 at the bottom."""
    width, height = image.size
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, image.channels)


def _to_linear(image: bpy.types.Image, pixels: Array) -> Array:
    """Convert pixels (..., channels) of an image to linear values (..., 3)."""
    values = pixels[..., :3] if image.channels >= 3 else np.repeat(pixels[..., :1], 3, axis=-1)
    if image.colorspace_settings.name == "sRGB" and not image.is_float:
        values = from_srgb(values)
    return values
