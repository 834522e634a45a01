"""Pictures of rendered pairs for screens, and sheets of pictures with captions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from ...render.pairs.pair_folder import Pair, read_pair
from ...support.arrays import Array
from ...support.files import write_bytes
from .develop import average_bands
from .exr import read_light
from .image_files import encode_image, read_picture

SCREEN_GAMMA = 1 / 2.2
#: JPEG qualities of a sheet; the first that gives a small enough file is used.
_JPEG_QUALITIES = range(90, 20, -5)
_DEFAULT_COLUMNS, _DEFAULT_CELL_PX = 3, 480
#: Height of a caption with a title and one line, px, and height of each further line.
_CAPTION_PX, _LINE_PX = 48, 16


def write_picture(pair_folder: Path, file: Path, stops: float = 0.0) -> None:
    """Write the view of a pair's left eye as a JPEG for screens, in colour, at the camera's automatic exposure.

    ``stops`` is the base-2 logarithm of a factor on that exposure. Matchers get a linear image; this picture has the
    gamma of screens, so it is brighter, and it has no noise.
    """
    pair = read_pair(pair_folder)
    radiance = read_radiance(pair)
    shown = to_screen_picture(radiance, find_automatic_white(radiance, pair) / 2.0**stops)
    write_bytes(file, encode_image(shown, ".jpg", 92))


def read_radiance(pair: Pair) -> Array:
    """Read the radiance (H, W, 3) at the left eye of a pair, red first."""
    return read_light(pair.image("left"), "left", groups=False).radiance


def find_automatic_white(radiance: Array, pair: Pair) -> float:
    """Find the radiance that is white at the automatic exposure of the pair's camera."""
    sensor = pair.settings.sensor
    return float(np.quantile(average_bands(radiance), sensor.auto_percentile)) / sensor.auto_target


def to_screen_picture(radiance: Array, white: float) -> Array:
    """Convert radiance (H, W, 3) to a picture for screens, uint8, blue first."""
    shown = np.clip(radiance / max(white, 1e-30), 0.0, 1.0) ** SCREEN_GAMMA
    return np.rint(255 * shown[..., ::-1]).astype(np.uint8)


def write_sheet(
    pictures: Sequence[tuple[Path | Array, str, str]],
    file: Path,
    most_bytes: int = 400_000,
    columns: int = _DEFAULT_COLUMNS,
    cell_px: int = _DEFAULT_CELL_PX,
) -> None:
    """Write pictures side by side, each with a title and lines of text below, as one JPEG of at most ``most_bytes``.

    A picture is a file, or uint8 grey (H, W) or BGR (H, W, 3); each is ``cell_px`` wide. Raises IcyMoonError if a
    picture cannot be read.
    """
    images = [
        _scale_to_width(each if isinstance(each, np.ndarray) else read_picture(each), cell_px)
        for each, _, _ in pictures
    ]
    height = max(image.shape[0] for image in images)
    caption_px = _CAPTION_PX + _LINE_PX * max(text.count("\n") for _, _, text in pictures)
    cells = [
        np.vstack(
            [
                np.pad(image, ((0, height - image.shape[0]), (0, 0), (0, 0))),
                _draw_caption(title, text, (caption_px, cell_px)),
            ]
        )
        for image, (_, title, text) in zip(images, pictures, strict=True)
    ]
    columns = min(columns, len(cells))
    cells += [np.zeros_like(cells[0])] * (-len(cells) % columns)
    sheet = np.vstack([np.hstack(cells[k : k + columns]) for k in range(0, len(cells), columns)])
    for quality in _JPEG_QUALITIES:
        content = encode_image(sheet, ".jpg", quality)
        if len(content) <= most_bytes:
            break
    write_bytes(file, content)


def _scale_to_width(image: Array, width: int) -> Array:
    image = np.repeat(image[..., None], 3, axis=-1) if image.ndim == 2 else image[..., :3]
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA))


def _draw_caption(title: str, text: str, size_px: tuple[int, int]) -> Array:
    caption = np.zeros((*size_px, 3), np.uint8)
    below = ((line, 38 + _LINE_PX * k, 0.4) for k, line in enumerate(text.splitlines()))
    for line, row, size in ((title, 18, 0.5), *below):
        cv2.putText(caption, line, (6, row), cv2.FONT_HERSHEY_SIMPLEX, size, (235, 235, 235), 1, cv2.LINE_AA)
    return caption
