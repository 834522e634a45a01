"""Which settings are hidden or grey, held against what they do."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from icymoon.panels.relevance import matters
from icymoon.physics.surfaces.hapke import bidirectional_reflectance, from_settings
from icymoon.settings.description import defaults

#: Other values of the numbers of Hapke's law.
OTHERS = {"w": 0.5, "b": 0.2, "c": 0.6, "b_s0": 0.9, "h_s": 0.05, "b_c0": 0.7, "h_c": 0.03, "theta_bar_deg": 20.0,
          "filling_factor": 0.3, "h_function": "2002"}


def root(**topics: dict) -> SimpleNamespace:
    """Stands in for ``Scene.icymoon``: the defaults with changes."""
    return SimpleNamespace(**{topic: SimpleNamespace(**values) for topic, values in (
        (topic, {**group, **topics.get(topic, {})}) for topic, group in defaults().items())})


@pytest.mark.parametrize("state", [
    {}, {"b": 0.0}, {"b_s0": 0.0}, {"b_c0": 0.0}, {"b_c0": 0.5, "h_c": 0.01}, {"b": 0.0, "b_s0": 0.0, "b_c0": 0.5}],
    ids=str)
@pytest.mark.parametrize("key", OTHERS)
def test_a_number_of_hapke_s_law_is_grey_where_another_changes_no_brightness(state, key):
    def brightness(**changes):
        law = from_settings({**defaults()["hapke"], "h_s": 0.01, "h_c": 0.01, **state, **changes})
        incidence, emission, azimuth = np.radians([[0.0, 20.0, 60.0], [1.0, 40.0, 50.0], [1.0, 30.0, 100.0]])
        return bidirectional_reflectance(incidence, emission, azimuth, law)

    acts = bool(np.any(brightness(**{key: OTHERS[key]}) != brightness()))
    assert matters("hapke", key, root(hapke=state)) == acts
