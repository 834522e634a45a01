"""Ground breaks off where Coulomb's law says, in any gravity, and what stands does not fail again."""

from __future__ import annotations

import math

import numpy as np
import pytest
from icymoon.physics.gravity.failing_slopes import Strength, cut_to_slope, find_highest_standing
from icymoon.physics.gravity.standing_slopes import GRAVITY_M_S2, critical_height_m

CELL_M = 0.05


def make_face(height_m: float, face_deg: float) -> np.ndarray:
    """A face that falls eastward, on 4 rows of 1000 cells; for 90 degrees it is one step."""
    east = (np.arange(1000) - 500) * CELL_M
    run = height_m / math.tan(math.radians(face_deg)) if face_deg < 90.0 else 0.0
    profile = np.where(east < 0.0, height_m, np.maximum(height_m - height_m * east / run, 0.0) if run else 0.0)
    return np.broadcast_to(profile, (4, 1000)).copy()


def find_weakest_plane(strength: Strength, face_deg: float) -> float:
    """Height in metres up to which a plane face stands, by Coulomb's law for wedges on many planes through its foot:
    weight times sine is cohesion times length plus weight times cosine times the tangent of friction."""
    face, friction = math.radians(face_deg), math.radians(strength.friction_deg)
    dip = np.linspace(friction, face, 20001)[1:-1]
    # Of a wedge of height H: area H² sin(β - θ) / (2 sin β sin θ), length of the plane H / sin θ.
    area = np.sin(face - dip) / (2.0 * math.sin(face) * np.sin(dip))
    driving = strength.density_kg_m3 * strength.gravity_m_s2 * area * (np.sin(dip) - np.cos(dip) * math.tan(friction))
    return float((strength.cohesion_pa / np.sin(dip) / driving).min())


@pytest.mark.parametrize("face_deg", [50.0, 65.0, 80.0, 90.0])
@pytest.mark.parametrize("moon", GRAVITY_M_S2)
def test_faces_stand_up_to_the_height_that_coulombs_law_gives(face_deg, moon):
    """Within the 3 % of the planes, and a cell of the grid."""
    gravity = GRAVITY_M_S2[moon]
    strength = Strength(0.25 * 600.0 * gravity, 35.0, 600.0, gravity)  # walls of 1.92 m on both moons
    highest = find_weakest_plane(strength, face_deg)
    low, high = 0.96 * highest - CELL_M, 1.04 * highest + 2 * CELL_M
    assert (find_highest_standing(make_face(low, face_deg), CELL_M, strength) >= make_face(low, face_deg)).all()
    assert (find_highest_standing(make_face(high, face_deg), CELL_M, strength) < make_face(high, face_deg)).any()


def test_an_upright_wall_keeps_its_critical_height_and_fails_above():
    strength = Strength(50.0, 35.0, 600.0, 1.315)
    stands = critical_height_m(50.0, 35.0, 600.0, 1.315)
    wall = make_face(3.0 * stands, 90.0)
    left = np.minimum(find_highest_standing(wall, CELL_M, strength), wall)[0]
    edge = int(np.flatnonzero(wall[0] == 0.0)[0]) - 1
    # The cell behind the edge is one cell from the foot, on a plane of 62.5 degrees.
    assert left[edge] == pytest.approx(stands + CELL_M * math.tan(math.radians(62.5)), rel=0.03)
    assert left[0] == 3.0 * stands


def test_walls_stand_as_much_higher_as_gravity_is_lower():
    """By the ratio of the gravities, to 4 %, because the planes are few and the cell at the edge is behind the foot."""

    def lowest_kept(gravity):
        wall = make_face(8.0, 90.0)
        limit = find_highest_standing(wall, CELL_M, Strength(20.0, 35.0, 600.0, gravity))
        return float(np.minimum(limit, wall)[0][wall[0] > 0].min()) - CELL_M * math.tan(math.radians(62.5))

    europa, enceladus = (lowest_kept(GRAVITY_M_S2[moon]) for moon in ("EUROPA", "ENCELADUS"))
    assert enceladus / europa == pytest.approx(1.315 / 0.1134, rel=0.04)


def test_without_cohesion_only_friction_counts_in_any_gravity():
    ground = np.random.default_rng(5).normal(0.0, 0.1, (64, 64)).cumsum(axis=1)
    first, second = (
        find_highest_standing(ground, CELL_M, Strength(0.0, 35.0, 600.0, gravity)) for gravity in (0.113, 1.315)
    )
    assert (first == second).all()
    assert (first <= ground).all()
    steps = max(float(np.abs(np.diff(first, axis=axis)).max()) for axis in (0, 1))
    assert steps <= CELL_M * math.tan(math.radians(35.0)) * (1 + 1e-6)


def test_what_stands_does_not_fail_again():
    ground = np.random.default_rng(2).normal(0.0, 0.3, (48, 64)).cumsum(axis=0)
    strength = Strength(30.0, 35.0, 600.0, 1.315)
    left = np.minimum(find_highest_standing(ground, CELL_M, strength), ground)
    assert (left < ground).any()
    again = np.minimum(find_highest_standing(left, CELL_M, strength), left)
    assert again == pytest.approx(left, abs=1e-9)


def test_slopes_are_cut_to_the_highest_gentle_surface_below():
    """Against the definition: the least of height and rise from each other cell. In 16 directions a distance is up to
    2.8 % longer."""
    ground = np.random.default_rng(1).uniform(0.0, 2.0, (23, 31))
    row, column = np.indices(ground.shape)
    away = CELL_M * np.hypot(row[..., None, None] - row, column[..., None, None] - column)
    exact, longer = ((ground + factor * 0.7 * away).min(axis=(2, 3)) for factor in (1.0, 1.028))
    low = cut_to_slope(ground, CELL_M, 0.7)
    assert (low >= exact - 1e-12).all()
    assert (low <= longer + 1e-12).all()


def test_weak_places_fail_first():
    wall = np.concatenate([make_face(2.2, 90.0)] * 8)
    strength = Strength(0.25 * 600.0 * 1.315, 35.0, 600.0, 1.315)  # 1.92 m, and 2.3 m where stronger
    share = np.ones(wall.shape)
    share[:16] = 1.2
    failed = find_highest_standing(wall, CELL_M, strength, share) < wall
    assert not failed[:16].any()
    assert failed[16:].any()
