"""The curve of sRGB against values of IEC 61966-2-1, and both directions against each other."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.support.srgb import from_srgb, to_srgb


def test_the_curve_has_the_values_of_the_standard():
    """18 % grey is 46.1 % of sRGB, and the linear part has the slope 12.92."""
    assert to_srgb(np.array([0.0, 0.001, 0.18, 1.0])) == pytest.approx([0.0, 0.01292, 0.4614, 1.0], abs=5e-5)


def test_each_direction_undoes_the_other():
    linear = np.linspace(0.0, 1.0, 1001)
    assert from_srgb(to_srgb(linear)) == pytest.approx(linear, abs=1e-6)  # the parts meet but for roundings of 1e-7
