"""Compares Hapke's formula with the results of other programs for the same angles and parameters."""

from __future__ import annotations

import math
from typing import Any

from ..physics.surfaces.hapke import HapkeParameters, bidirectional_reflectance
from .comparison import Bench, Comparison, Row

_ISIS = "USGS ISIS 3, isis/src/base/objs/Hapke/Hapke.truth, printed with six digits"
_ERADIATE = "eradiate-mitsuba, src/eradiate_plugins/tests/bsdfs/test_hapke.py, single precision"
_LOBE: dict[str, Any] = {
    "w": 0.52,
    "b": 0.213,
    "c": 1.0,
    "b_s0": 1.0,
    "h_s": 1.0,
    "theta_bar": math.radians(30.0),
    "h_function": "1981",
}
_DEFAULTS: dict[str, Any] = {"w": 0.5, "h_function": "1981"}
_LEVEL: dict[str, Any] = _LOBE | {"b": 0.0}
_DUST: dict[str, Any] = {
    "w": 0.526,
    "theta_bar": math.radians(13.3),
    "b": 0.187,
    "c": 2 * 0.6365 - 1,
    "h_s": 0.083,
    "b_s0": 1.0,
}
#: Azimuth of ISIS' point with phase, incidence and emission of 60, 45 and 30 degrees.
_ISIS_AZIMUTH_DEG = math.degrees(
    math.acos(
        (0.5 - math.cos(math.radians(45)) * math.cos(math.radians(30)))
        / (math.sin(math.radians(45)) * math.sin(math.radians(30)))
    )
)

#: (parameters, name of the set, incidence, emission, azimuth in degrees, whether over cos i, value, source).
_REFERENCE_POINTS = (
    (_DEFAULTS, "HapkeHen, defaults", 0.0, 0.0, 0.0, False, 0.0965097, _ISIS),
    (_DEFAULTS, "HapkeHen, defaults", 45.0, 30.0, _ISIS_AZIMUTH_DEG, False, 0.0832883, _ISIS),
    (_LOBE, "HapkeHen, one lobe, rough", 0.0, 0.0, 0.0, False, 0.286048, _ISIS),
    (_LOBE, "HapkeHen, one lobe, rough", 45.0, 30.0, _ISIS_AZIMUTH_DEG, False, 0.1342, _ISIS),
    (_LEVEL, "HapkeLeg, even, rough", 0.0, 0.0, 0.0, False, 0.16145, _ISIS),
    (_LEVEL, "HapkeLeg, even, rough", 45.0, 30.0, _ISIS_AZIMUTH_DEG, False, 0.111525, _ISIS),
    (_DUST, "Pommerol", 30.0, 30.0, 0.0, True, 0.24746648, _ERADIATE),
    (_DUST, "Pommerol", 30.0, 80.0, 0.0, True, 0.19555340, _ERADIATE),
    (_DUST, "Pommerol", 30.0, 89.0, 180.0, True, 0.15426355, _ERADIATE),
)
#: Six printed digits, and single precision at grazing angles.
_TOLERANCE = 5e-6


def _compare_codes(bench: Bench) -> list[Row]:
    rows = []
    for parameters, name, i, e, azimuth, over_cosine, value, source in _REFERENCE_POINTS:
        r = float(
            bidirectional_reflectance(
                math.radians(i), math.radians(e), math.radians(azimuth), HapkeParameters(**parameters)
            )
        )
        ours = math.pi * r / (math.cos(math.radians(i)) if over_cosine else 1.0)
        rows.append(
            Row(
                f"{name}: {'reflectance factor' if over_cosine else 'I/F'} at i {i:g}°, e {e:g}°, azimuth "
                f"{azimuth:.4g}°",
                ours,
                value,
                _TOLERANCE * max(1.0, value),
                source,
            )
        )
    return rows


COMPARISON = Comparison(
    "codes",
    "Hapke's formula in other programs",
    "The tests of other programs state these values. Icy Moon's own tests use another table, with 50 digits and "
    "many hundred rows.",
    _compare_codes,
)
