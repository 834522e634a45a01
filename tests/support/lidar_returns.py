"""Returns of a pulse of 1 ns at 532 nm, without a scene."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from icymoon.physics.lidar.instrument import Instrument
from icymoon.physics.lidar.returns import NO_RETURNS, Returns
from icymoon.physics.lidar.scan_patterns import ScanPattern

PULSE_S = 1e-9
#: Labels of a hard surface, and of one that is ice.
HARD, ICE = 1, 2


def instrument(beams: int = 40, **values: Any) -> Instrument:
    given: dict[str, Any] = {"wavelength_m": 532e-9, "farthest_m": 100.0, "pulse_fwhm_s": PULSE_S, **values}
    return Instrument(ScanPattern("FLASH", 1, beams, 10, 10), 1e-6, (1e-3, 1e-3), 0.02, **given)


def returns(photons: Any, range_m: Any = 10.0, label: int = HARD, beam: Any = None, order: Any = 1) -> Returns:
    """Returns with expected numbers of photons at 532 nm, one for each beam."""
    photons, range_m = np.broadcast_arrays(np.atleast_1d(photons).astype(float), np.asarray(range_m, float))
    count = len(photons)
    made = {
        name: np.zeros((count, *getattr(NO_RETURNS, name).shape[1:]), getattr(NO_RETURNS, name).dtype)
        for name in (field.name for field in fields(Returns))
    }
    made |= {
        "beam": np.arange(count) if beam is None else np.asarray(beam),
        "order": np.broadcast_to(np.asarray(order, np.uint8), count),
        "range_m": range_m,
        "true_range_m": range_m,
        "energy_j": photons / instrument().count_photons(np.ones(1)),
        "label": np.full(count, label, np.uint8),
    }
    return Returns(**made)
