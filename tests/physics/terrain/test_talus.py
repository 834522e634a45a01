"""Talus of procedural ground: off by default, known at each point, the same for every mesh."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from icymoon.physics.terrain import talus
from icymoon.physics.terrain.terrain import Terrain, advise_on_terrain, make_terrain
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError

PLATES: dict[str, dict[str, Any]] = {
    "terrain": {"size_m": 10.0, "rms_slope_deg": 4.0, "hurst": 0.75, "inner_scale_m": 0.03},
    "chaos": {"relief_m": 1.0, "plate_m": 3.0, "edges": "BROKEN"},
    "talus": {"share": 1.0, "cohesion_pa": 20.0},
    "light": {"body": "EUROPA"},
}


@pytest.fixture(autouse=True)
def _fewer_points(monkeypatch):
    """A quarter of the points, 4.7 cm apart on these patches, as those of the default patch are."""
    monkeypatch.setattr(talus, "_SIDE", 256)
    talus._find_fallen.cache_clear()
    yield
    talus._find_fallen.cache_clear()


def described(*changes: dict[str, dict[str, Any]]) -> Settings:
    return merged(defaults(), PLATES, *changes)


def make_points(count: int, half_m: float = 5.0) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.random.default_rng(1).uniform(-half_m, half_m, (2, count))
    return x, y


def without(ground: Terrain) -> Terrain:
    return replace(ground, talus=None)


def test_ground_has_no_talus_unless_it_is_asked_for():
    assert make_terrain(described({"talus": {"share": 0.0}}), 3).talus is None
    assert make_terrain(defaults(), 3).talus is None
    assert make_terrain(described({"source": {"kind": "HEIGHT_MAP"}}), 3).talus is None


def test_the_volume_of_talus_is_the_bulked_volume_of_what_broke_off():
    """Integrated over the patch at 250 000 points; a little crosses the side of the patch, within 5 % here."""
    ground = make_terrain(described(), 3)
    axis = (np.arange(500) + 0.5) / 50.0 - 5.0
    before = without(ground).heights(axis[None, :], axis[:, None])
    after, loose = (each(axis[None, :], axis[:, None]) for each in (ground.heights, ground.measure_loose))
    broken = before - (after - loose)
    assert broken.min() > -1e-9
    assert broken.sum() / 2500.0 > 0.5
    assert loose.sum() == pytest.approx(1.4 * broken.sum(), rel=0.05)


def test_a_share_of_it_may_be_gone():
    ground, half = (make_terrain(described({"talus": {"share": share}}), 3) for share in (1.0, 0.5))
    x, y = make_points(40000)
    assert half.measure_loose(x, y).sum() == pytest.approx(0.5 * ground.measure_loose(x, y).sum(), rel=0.05)


@pytest.mark.parametrize("carried", [0.05, 0.2])
def test_a_coarse_mesh_has_the_talus_of_a_fine_one(carried):
    """Thickness at the same points, for vertices that carry each length: 2 cm apart in root mean square where there is
    talus, an eighth of its mean of 0.16 m."""
    ground = make_terrain(described(), 3)
    x, y = make_points(20000)
    fine, coarse = (ground.measure_loose(x, y, np.full(len(x), each)) for each in (0.02, carried))
    there = (fine > 0.02) | (coarse > 0.02)
    assert there.mean() > 0.02
    assert np.sqrt(np.mean((fine - coarse)[there] ** 2)) < 0.02


def test_a_uniform_mesh_without_a_landform_lacks_its_talus():
    ground = make_terrain(described(), 3)
    x, y = make_points(2000)
    assert not ground.measure_loose(x, y, 5.0).any()
    assert ground.heights(x, y, 5.0) == pytest.approx(without(ground).heights(x, y, 5.0), abs=1e-12)


def test_points_do_not_depend_on_their_order_or_number():
    ground = make_terrain(described(), 3)
    x, y = make_points(3000)
    every = ground.heights(x, y, np.full(3000, 0.05))
    assert (ground.heights(x[::-1], y[::-1], np.full(3000, 0.05))[::-1] == every).all()
    assert ground.heights(x[7], y[7], 0.05) == pytest.approx(every[7], abs=1e-12)


def test_equal_settings_share_one_result_and_others_do_not():
    first, second = (make_terrain(described({"rig": {"x_m": x}}), 3).talus for x in (0.0, 1.0))
    assert first.fallen is second.fallen
    assert make_terrain(described(), 4).talus.fallen is not first.fallen
    assert make_terrain(described({"chaos": {"tilt_deg": 9.0}}), 3).talus.fallen is not first.fallen


def test_talus_counts_the_regional_slope_and_lies_under_snow():
    """Cohesionless ground on a slope of 30 degrees fails where its relief makes it steeper than 35."""
    slope = {"terrain": {"size_m": 10.0, "regional_slope_deg": 30.0}, "chaos": {"relief_m": 0.0}}
    ground = make_terrain(described(slope, {"talus": {"cohesion_pa": 0.0}}), 3)
    flat = make_terrain(described(slope, {"terrain": {"regional_slope_deg": 0.0}, "talus": {"cohesion_pa": 0.0}}), 3)
    assert ground.talus.fallen.broken_m3 > 10.0 * (flat.talus.fallen.broken_m3 if flat.talus.fallen else 0.0)
    snowy = make_terrain(described({"mantle": {"thickness_m": 0.1}}), 3)
    x, y = make_points(5000)
    bare = replace(snowy, mantle_thickness_m=0.0)
    assert (snowy.measure_loose(x, y) >= bare.measure_loose(x, y)).all()
    hard, same = (each.heights(x, y) - each.measure_loose(x, y) for each in (snowy, bare))
    assert hard == pytest.approx(same, abs=1e-12)


def test_talus_goes_on_around_the_patch_and_ends():
    """On a coarser grid up to four sides of the patch; without a step where one grid takes over from the other."""
    ground = make_terrain(described(), 3)
    x = np.linspace(24.01, 40.0, 500)
    assert (ground.heights(x, 0.3 * x) == without(ground).heights(x, 0.3 * x)).all()
    x, y = make_points(4000, 18.0)
    outer = np.maximum(np.abs(x), np.abs(y)) > 6.0
    assert (ground.measure_loose(x, y)[outer] > 0.05).mean() > 0.05
    across = np.linspace(4.9, 6.1, 1201)
    fails = ground.heights(across, 1.3, 0.1) - without(ground).heights(across, 1.3, 0.1)
    smooth = make_terrain(described({"chaos": {"edges": "ROUNDED"}}), 3)
    steps = np.diff(smooth.measure_loose(across, 1.3, 0.1))
    assert np.isfinite(fails).all()
    assert np.abs(steps).max() < 0.01


def test_a_moon_of_unknown_gravity_needs_a_stated_one():
    with pytest.raises(IcyMoonError, match=r"gravity of TITAN is unknown.*talus\.gravity_m_s2"):
        make_terrain(described({"light": {"body": "TITAN"}}), 3)
    assert make_terrain(described({"light": {"body": "TITAN"}, "talus": {"gravity_m_s2": 1.35}}), 3).talus is not None


def test_ground_that_stands_is_reported():
    said = advise_on_terrain(described({"light": {"body": "ENCELADUS"}, "talus": {"cohesion_pa": 500.0}}), 0.05)
    assert [each for each in said if "upright walls of 56 m stand at 0.113 m/s²" in each]
    assert not [each for each in advise_on_terrain(described(), 0.05) if "fails" in each]


def test_time_and_memory_do_not_grow_with_the_patch():
    """One grid for any patch: a patch of a kilometre takes the points of one of 10 m."""
    small, large = (make_terrain(described({"terrain": {"size_m": size}}), 3).talus for size in (10.0, 1000.0))
    assert small.make_grid(1.0).side == large.make_grid(1.0).side
    start = time.process_time()
    assert large.fallen is None or large.fallen.top_m.size <= 256**2
    assert time.process_time() - start < 20.0
