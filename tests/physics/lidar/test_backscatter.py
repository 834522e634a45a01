"""The table of reflectance at phase 0 against the laws themselves."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from icymoon.physics.lidar.backscatter import tabulate_backscatter, tabulate_scene
from icymoon.physics.surfaces.hapke import HapkeParameters, bidirectional_reflectance
from icymoon.physics.surfaces.photometry import lunar_lambert
from icymoon.physics.surfaces.snow import snow_law
from icymoon.settings.description import check, defaults, merged
from icymoon.support.labels import ROCK, TERRAIN

SURGE = HapkeParameters(0.9, 0.3, 0.2, b_s0=0.6, h_s=0.05, b_c0=0.5, h_c=0.005, theta_bar=0.3)


@pytest.mark.parametrize(
    "law",
    [
        lunar_lambert(0.8, 0.0),
        lunar_lambert(0.8, 0.6),
        snow_law(0.95),
        partial(bidirectional_reflectance, parameters=SURGE),
    ],
    ids=["lambert", "lunar", "snow", "hapke"],
)
def test_the_table_is_the_law(law):
    angle = np.radians(np.linspace(0, 85, 997))
    assert tabulate_backscatter(law).find(np.cos(angle)) == pytest.approx(law(angle, angle, 0 * angle), rel=1e-6)
    assert np.isfinite(tabulate_backscatter(law).find(np.array([0.0, 1e-9, 1.0]))).all()


def test_the_opposition_surge_is_in_it():
    table = tabulate_backscatter(partial(bidirectional_reflectance, parameters=SURGE))
    off = bidirectional_reflectance(0.0, np.radians(30), 0.0, SURGE)
    assert table.find(np.ones(1))[0] > 1.5 * off


def test_ground_and_rocks_have_the_laws_of_their_surfaces():
    scene: dict[str, Any] = {
        "surface": {"model": "LAMBERT", "albedo": 0.8},
        "rocks": {"own_surface": True},
        "rock_surface": {"model": "LAMBERT", "albedo": 0.2},
    }
    laws = tabulate_scene(merged(defaults(), check(scene, "test")))
    head_on = np.ones(1)
    assert laws[TERRAIN].find(head_on) == pytest.approx([0.8 / np.pi])
    assert laws[ROCK].find(head_on) == pytest.approx([0.2 / np.pi])
    scene["rocks"]["own_surface"] = False
    assert tabulate_scene(merged(defaults(), check(scene, "test")))[ROCK].find(head_on) == pytest.approx([0.8 / np.pi])
