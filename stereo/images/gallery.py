"""Pictures of rendered pairs for screens, and sheets of many with captions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from ...render.pairs.pair_folder import read_pair
from ...support.arrays import Array
from .develop import grey
from .exr import read_light
from .image_files import encoded, read_picture, write_bytes

_SCREEN_GAMMA = 1 / 2.2
#: JPEG qualities of a sheet; the first that gives a small enough file is taken.
_QUALITIES = range(90, 20, -5)
_COLUMNS, _CELL_PX, _CAPTION_PX = 3, 480, 48


def write_picture(pair_folder: Path, file: Path, stops: float = 0.0) -> None:
    """Write the view of a pair's left eye as a JPEG for screens, in colour, at the camera's automatic exposure.

    ``stops`` is the logarithm, to the base 2, of a factor on that exposure. Matchers get a linear image; this one has
    the gamma of screens, so it is brighter, and it has no noise.
    """
    pair = read_pair(pair_folder)
    radiance, sensor = read_light(pair.image("left"), "left", groups=False).radiance, pair.settings.sensor
    full = float(np.quantile(grey(radiance), sensor.auto_percentile)) / sensor.auto_target / 2.0**stops
    shown = np.clip(radiance / max(full, 1e-30), 0.0, 1.0) ** _SCREEN_GAMMA
    write_bytes(file, encoded(np.rint(255 * shown[..., ::-1]).astype(np.uint8), ".jpg", 92))


def write_sheet(pictures: Sequence[tuple[Path, str, str]], file: Path, most_bytes: int = 400_000) -> None:
    """Write pictures side by side, each with a title and a line of text below, as one JPEG of at most ``most_bytes``.

    Raises IcyMoonError if a picture cannot be read.
    """
    cells = [_read_cell(*picture) for picture in pictures]
    columns = min(_COLUMNS, len(cells))
    height = max(cell.shape[0] for cell in cells)
    cells = [np.pad(cell, ((0, height - cell.shape[0]), (0, 0), (0, 0))) for cell in cells]
    cells += [np.zeros_like(cells[0])] * (-len(cells) % columns)
    sheet = np.vstack([np.hstack(cells[k : k + columns]) for k in range(0, len(cells), columns)])
    for quality in _QUALITIES:
        content = encoded(sheet, ".jpg", quality)
        if len(content) <= most_bytes:
            break
    write_bytes(file, content)


def _read_cell(picture: Path, title: str, line: str) -> Array:
    image = read_picture(picture)
    image = np.repeat(image[..., None], 3, axis=-1) if image.ndim == 2 else image[..., :3]
    height = max(1, round(image.shape[0] * _CELL_PX / image.shape[1]))
    caption = np.zeros((_CAPTION_PX, _CELL_PX, 3), np.uint8)
    for text, row, size in ((title, 18, 0.5), (line, 38, 0.4)):
        cv2.putText(caption, text, (6, row), cv2.FONT_HERSHEY_SIMPLEX, size, (235, 235, 235), 1, cv2.LINE_AA)
    return np.vstack([cv2.resize(image, (_CELL_PX, height), interpolation=cv2.INTER_AREA), caption])
