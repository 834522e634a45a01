"""Adds the light of one pass to another in OpenEXR files, without an OpenEXR library.

Only the passes whose light changes are decoded; other parts are copied.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ..support.arrays import Array
from ..support.labels import BAKED_AOVS, BAKED_ERROR_PASSES, BEAUTY, IMAGE_PASS, LAMP_GROUPS, LIGHT_GROUPS
from .exr_parts import Piece
from .exr_pixels import Pixels

#: Largest relative difference between an image and the sum of its lights: a few roundings in single precision.
_SUM_ERROR = 2.0**-20


def _find_bands(parts: list[Pixels], wanted: str) -> dict[str, tuple[int, int]]:
    """Find the indices (part, channel) of each of the bands R, G and B of the pass ``wanted`` (``LAYER.PASS``)."""
    return {
        name[-1]: (number, k)
        for number, part in enumerate(parts)
        for k, name in enumerate(part.channels)
        if name.startswith(f"{wanted}.") and name[-2:] in (".R", ".G", ".B")
    }


def _read_bands(parts: list[Pixels], wanted: str) -> dict[str, Array]:
    """Read the bands R, G and B of a pass, each (height, width) float32. Raises KeyError if a band is missing."""
    found = _find_bands(parts, wanted)
    decoded = {number: parts[number].decode() for number in {number for number, _ in found.values()}}
    return {band: decoded[found[band][0]][:, found[band][1]] for band in "RGB"}


def add_group(image: Sequence[Piece], other: Sequence[Piece], group: str) -> list[Piece]:
    """Add a light group's light from ``other`` to the image and to this light group of ``image``; return the parts.

    Raises ValueError or KeyError for parts that cannot be added.
    """
    name = f"{IMAGE_PASS}_{group}"
    light = _read_bands([Pixels(piece) for piece in other], name)
    return _add_light(image, {IMAGE_PASS: light, name: light})[0]


def add_light(image: Sequence[Piece], light: Mapping[str, Mapping[str, Array]]) -> list[Piece]:
    """Add ``light`` (bands R, G, B by pass ``LAYER.PASS``) to the existing passes of ``image``; return the parts.

    Raises as ``add_group`` does.
    """
    parts = [Pixels(piece) for piece in image]
    return _add_light(image, {name: bands for name, bands in light.items() if _find_bands(parts, name)})[0]


def add_baked(image: Sequence[Piece]) -> tuple[list[Piece], dict[str, float]]:
    """Add the passes of baked light to the image and to its light groups, if it has any. Returns the parts, and the
    share of baked light in all light of the image for each light group. The share is nan if a pixel has negative light,
    which marks ground without baked light. Raises as ``add_group`` does."""
    parts = [Pixels(piece) for piece in image]
    there = [group for group, name in BAKED_AOVS.items() if _find_bands(parts, f"{BEAUTY}.{name}")]
    light = {group: _read_bands(parts, f"{BEAUTY}.{BAKED_AOVS[group]}") for group in there or BAKED_AOVS}
    if any(values.min(initial=0.0) < 0.0 for bands in light.values() for values in bands.values()):
        return list(image), dict.fromkeys(light, math.nan)
    added = {
        f"{BEAUTY}.Combined_{group}": bands
        for group, bands in light.items()
        if _find_bands(parts, f"{BEAUTY}.Combined_{group}")
    }
    whole = {band: np.sum([bands[band] for bands in light.values()], axis=0, dtype=np.float32) for band in "RGB"}
    lit, total = _add_light(image, {IMAGE_PASS: whole, **added})
    return lit, {
        group: sum(float(values.sum(dtype=np.float64)) for values in bands.values()) / total if total > 0 else 0.0
        for group, bands in light.items()
    }


def measure_baked_noise(image: Sequence[Piece]) -> float | None:
    """Measure the noise of baked light relative to all light, in parts that ``add_baked`` returned: the root mean
    square of its error divided by the mean radiance, both over pixels with baked light. None if no pixel has any.
    Raises as ``add_group`` does."""
    parts = [Pixels(piece) for piece in image]

    def total(wanted: Collection[str]) -> Array:
        """Add up the channels of some passes, except alpha: (height, width)."""
        found = [
            (
                part,
                [
                    k
                    for k, name in enumerate(part.channels)
                    if ".".join(name.split(".")[:2]) in wanted and name[-1] != "A"
                ],
            )
            for part in parts
        ]
        return np.sum(
            [part.decode()[:, channels].sum(axis=1, dtype=np.float64) for part, channels in found if channels], axis=0
        )

    lit = total({f"{BEAUTY}.{name}" for name in BAKED_AOVS.values()}) > 0
    light = total({IMAGE_PASS})[lit].sum() / 3
    if light <= 0:
        return None
    error = total(set(BAKED_ERROR_PASSES.values()))[lit]
    return float(np.sqrt(np.mean(error**2)) * error.size / light)


def is_sum_of_lights(image: Sequence[Piece]) -> bool:
    """Return whether the image is the sum of its light groups, so that only the groups need to be stored. False if the
    image was denoised, has no groups, or is of an unsupported kind."""
    try:
        parts = [Pixels(piece) for piece in image]
        lamps = [group for group in LAMP_GROUPS if _find_bands(parts, f"{IMAGE_PASS}_{group}")]
        names = [f"{IMAGE_PASS}_{group}" for group in (*LIGHT_GROUPS, *lamps)]
        whole, *lights = (_read_bands(parts, name) for name in (IMAGE_PASS, *names))
    except (KeyError, ValueError):
        return False
    sums = {band: np.sum([light[band] for light in lights], axis=0) for band in "RGB"}
    return all((np.abs(sums[band] - whole[band]) <= _SUM_ERROR * np.abs(whole[band])).all() for band in "RGB")


def _add_light(image: Sequence[Piece], light: Mapping[str, Mapping[str, Array]]) -> tuple[list[Piece], float]:
    """Return the parts with ``light`` (decoded bands by pass) added, and the sum of all values of the new image."""
    parts = [Pixels(piece) for piece in image]
    values: dict[int, Array] = {}
    total = 0.0
    for wanted, bands in light.items():
        found = _find_bands(parts, wanted)
        for band in "RGB":
            number, k = found[band]
            if number not in values:
                values[number] = parts[number].decode()
            values[number][:, k] += bands[band]
            total += float(values[number][:, k].sum(dtype=np.float64)) if wanted == IMAGE_PASS else 0.0
    return [parts[k].encode(values[k]) if k in values else piece for k, piece in enumerate(image)], total
