"""Writes a program's own heights, albedos and rocks (arrays or functions) as files of a data set.

A file is named after its content, so the same array is stored once, and the id of a pair depends on the content.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..formats.tiff_write import encode_tiff
from ..physics.rocks.painted_mask import MASK_SETTINGS, find_pixel_centres
from ..physics.rocks.rock_table import ROCK_COLUMNS, TABLE, covered_share
from ..render.pairs.dataset_file_names import INPUTS
from ..settings.description import defaults
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import read_checksum, write_bytes
from ..support.number_text import format_count

#: A quantity over the patch: an array, or a function of arrays of east and north coordinates in metres.
Field = Callable[[Array, Array], ArrayLike] | ArrayLike
#: Largest mean albedo, as in ``surface.albedo``.
_LARGEST_MEAN_ALBEDO = 1.0


@dataclass(frozen=True)
class Input:
    """A file of a program's own data: its ``content``, the ``setting`` that names the file, and a ``text`` that
    describes it in the ``repr`` of a scene."""

    setting: str
    content: bytes
    suffix: str
    text: str

    def store(self, dataset: Path) -> Path:
        """Write the file into a data set, unless it exists, and return its path.

        Raises IcyMoonError if its path is a link, which may lead out of the data set.
        """
        name = hashlib.sha256(self.content).hexdigest()[:16]
        path = dataset / INPUTS / f"{name}{self.suffix}"
        if link := next((each for each in (path.parent, path) if each.is_symlink()), None):
            raise IcyMoonError(
                f"{link} is a link, but inputs of a program must be stored in the data set itself; remove the link, "
                "or choose another folder."
            )
        if not path.is_file() or read_checksum(path) != hashlib.sha256(self.content).hexdigest():
            write_bytes(path, self.content)
        return path


def sample_field(field: Field, x_m: Array, y_m: Array, what: str) -> Array:
    """Return the values (rows, columns) or (rows, columns, 3), float64, of an array, or of a function at ``x_m``,
    ``y_m``.

    Raises IcyMoonError if a function fails on arrays or gives another shape, and for values that are not finite.
    """
    if callable(field):
        try:
            found = np.asarray(field(x_m, y_m), np.float64)
        except (TypeError, ValueError) as error:
            raise IcyMoonError(
                f"The function of {what} does not take arrays of coordinates ({error}); compute with "
                "numpy, or wrap it in numpy.vectorize."
            ) from error
        values = np.broadcast_to(found, x_m.shape) if found.ndim <= 2 and found.size == 1 else found
        if values.shape[:2] != x_m.shape:
            raise IcyMoonError(
                f"The function of {what} gives an array of shape {found.shape} for coordinates of shape "
                f"{x_m.shape}; give one value for each place."
            )
    else:
        try:
            values = np.asarray(field, np.float64)
        except (TypeError, ValueError):
            raise IcyMoonError(
                f"The argument {what} is not an array of numbers; give one, or a function f(x_m, y_m)."
            ) from None
    if values.ndim < 2 or min(values.shape[:2]) < 2:
        raise IcyMoonError(
            f"The array of {what} has the shape {values.shape}; give at least 2 x 2 values, north first."
        )
    if not np.isfinite(values).all():
        raise IcyMoonError(
            f"The array of {what} has {format_count(np.count_nonzero(~np.isfinite(values)), 'value')} "
            "that are not finite; fill them."
        )
    return values


def make_heights_input(
    field: Field, size_m: float, resolution: int, pixel_m: float | None
) -> tuple[Input, dict[str, dict[str, Any]]]:
    """Make the file of heights in metres, and the settings that go with it.

    A function is sampled at the vertices of the ground: ``resolution`` along each side of the patch of ``size_m``. The
    outermost values of an array are on the edges of the patch; with ``pixel_m`` between neighbours, the patch is as
    large as the array. Raises IcyMoonError as ``sample_field`` does.
    """
    at = np.linspace(-size_m / 2, size_m / 2, resolution)
    x_m, y_m = np.meshgrid(at, at[::-1])
    values = sample_field(field, x_m, y_m, "heights")
    if values.ndim != 2:
        raise IcyMoonError(f"The heights have the shape {values.shape}; give one height for each place.")
    rows, columns = values.shape
    pixel_m = float(pixel_m) if pixel_m else size_m / (max(rows, columns) - 1)
    stream = io.BytesIO()
    np.save(stream, values, allow_pickle=False)
    given = Input("source.file", stream.getvalue(), ".npy", f"own heights {rows} x {columns}")
    return given, {
        "source": {
            "kind": "HEIGHT_MAP",
            "metres_per_pixel": pixel_m,
            "height_scale_m": 1.0,
            "centre": False,
            "origin_x_m": (columns - 1) * pixel_m / 2,
            "origin_y_m": (rows - 1) * pixel_m / 2,
        },
        "terrain": {"size_m": (max(rows, columns) - 1) * pixel_m, "resolution": max(rows, columns)},
    }


def make_rocks_input(rocks: ArrayLike, size_m: float) -> tuple[Input, dict[str, dict[str, Any]]]:
    """Make the table of rocks (n, 3), and the settings that go with it. A row has the position east and north and the
    diameter, in metres.

    Raises IcyMoonError for another shape, numbers that are not finite, and diameters that are not above 0.
    """
    try:
        table = np.asarray(rocks, np.float64)
    except (TypeError, ValueError):
        raise IcyMoonError("The rocks are not an array of numbers; give (n, 3): x_m, y_m, diameter_m.") from None
    if table.ndim != 2 or table.shape[1] != len(ROCK_COLUMNS) or not len(table):
        raise IcyMoonError(f"The rocks have the shape {table.shape}; give (n, 3): x_m, y_m, diameter_m.")
    if not np.isfinite(table).all() or (table[:, 2] <= 0).any():
        raise IcyMoonError("Some rocks have no finite place, or no diameter above 0; leave them out.")
    lines = [",".join(ROCK_COLUMNS), *(",".join(map(repr, row)) for row in table.tolist()), ""]
    stated: dict[str, Any] = {"law": TABLE, "coverage": min(max(covered_share(table, size_m), 1e-6), 0.5)}
    if len(table) > defaults().rocks.most:
        stated["most"] = len(table)
    return Input("rocks.file", "\n".join(lines).encode(), ".csv", format_count(len(table), "own rock")), {
        "rocks": stated
    }


def make_mask_input(of: str, field: Field, size_m: float, resolution: int) -> Input:
    """Make the image of shares from 0 to 1 of rocks, dirt or frost over the patch.

    A function is sampled at the centres of ``resolution`` x ``resolution`` pixels that fill the patch; an array fills
    it. Raises IcyMoonError as ``sample_field`` does, for another name, and for values outside 0 to 1.
    """
    if of not in MASK_SETTINGS:
        raise IcyMoonError(f"There is no mask of {of!r}; choose {', '.join(MASK_SETTINGS)}.")
    x_m, y_m = find_pixel_centres(size_m, resolution)
    values = sample_field(field, x_m, y_m, "shares")
    if values.ndim != 2:
        raise IcyMoonError(f"The shares have the shape {values.shape}; give one for each place.")
    if values.min() < 0 or values.max() > 1:
        raise IcyMoonError(f"The shares are {values.min():.3g} to {values.max():.3g}; give 0 to 1.")
    stream = io.BytesIO()
    np.save(stream, values.astype(np.float32), allow_pickle=False)
    shape = " x ".join(map(str, values.shape))
    return Input(".".join(MASK_SETTINGS[of]), stream.getvalue(), ".npy", f"own mask of {of} {shape}")


def make_albedo_input(field: Field, size_m: float, resolution: int) -> tuple[Input, dict[str, dict[str, Any]]]:
    """Make the image of albedos over the patch, and the settings that go with it.

    A function is sampled at the centres of ``resolution`` x ``resolution`` pixels that fill the patch; an array fills
    it. Raises IcyMoonError as ``sample_field`` does, and for albedos outside 0 to 1.
    """
    x_m, y_m = find_pixel_centres(size_m, resolution)
    values = sample_field(field, x_m, y_m, "albedos")
    if values.ndim > 3 or (values.ndim == 3 and values.shape[2] != 3):
        raise IcyMoonError(f"The albedos have the shape {values.shape}; give one for each place, or one for each band.")
    if values.min() < 0 or values.max() > _LARGEST_MEAN_ALBEDO:
        raise IcyMoonError(f"The albedos are {values.min():.3g} to {values.max():.3g}; give 0 to 1.")
    image = encode_tiff(np.ascontiguousarray(values, np.float32), description="albedo")
    shape = " x ".join(map(str, values.shape[:2]))
    return Input("textures.albedo_file", image, ".tif", f"own albedo {shape}"), {
        "surface": {
            "albedo": float(values.mean()),
            "albedo_variation": 0.0,
            "trough_dirt": 0.0,
            "slope_dirt": 0.0,
            "salt_share": 0.0,
        },
        "textures": {
            "set": "OWN",
            "mapping": "PATCH",
            "roughness_file": "",
            "normal_file": "",
            "transmission_file": "",
            "height_file": "",
        },
    }
