"""Scans of tiny worlds against formulas for planes, and of blocks against many rays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from icymoon.physics.camera.rotations import from_vector
from icymoon.physics.lidar.apd import Apd
from icymoon.physics.lidar.backscatter import Backscatter, tabulate_backscatter
from icymoon.physics.lidar.digitiser import make_digitiser
from icymoon.physics.lidar.instrument import Instrument, SensorPose, make_pose
from icymoon.physics.lidar.light_in_ice import make_snow
from icymoon.physics.lidar.measured_returns import AnalogReceiver, Sensing
from icymoon.physics.lidar.returns import Returns, join_returns
from icymoon.physics.lidar.scan_patterns import ScanPattern
from icymoon.physics.surfaces.photometry import lunar_lambert
from icymoon.rays import lidar
from icymoon.rays.embree import load_library
from icymoon.rays.engine import open_tracer
from icymoon.rays.lidar import scan, scan_and_measure, scan_whole
from icymoon.rays.shapes import Placed, World
from icymoon.support.errors import IcyMoonError
from lidar_beams import compare_with_many_rays
from ray_worlds import BOX, block_field, shape

pytestmark = pytest.mark.skipif(load_library() is None, reason="there is no Embree; pip install embreex")

HOME = make_pose((0, 0, 0), (1, 0, 0, 0))
ONE = ScanPattern("RASTER", 1, 1, 0, 0)
LAMBERT = {label: tabulate_backscatter(lunar_lambert(0.7, 0.0)) for label in (1, 2)}


def plane(distance_m: float, incidence_deg: float) -> World:
    """A plane that the x axis meets at a distance and an angle of incidence."""
    turn = np.radians(incidence_deg)
    along, across = np.array([np.sin(turn), 0, np.cos(turn)]), np.array([0, 1.0, 0])
    corners = np.array([distance_m, 0, 0]) + 100 * distance_m * np.array(
        [-along - across, along - across, along + across, across - along]
    )
    return World([Placed(shape(corners, [[0, 1, 2], [0, 2, 3]]), np.eye(4)[None], np.array([7]))])


def distance_on_axis(world: World) -> float:
    """The distance in metres along the x axis to the plane of the first triangle, whose corners are rounded."""
    a, b, c = world.placed[0].shape.vertices[:3].astype(float)
    normal = np.cross(b - a, c - a)
    return float(normal @ a / normal[0])


def measure(world: World, pose: SensorPose = HOME, laws: dict[int, Backscatter] = LAMBERT, **values: Any) -> Returns:
    """The returns of an instrument of 1 µJ and an aperture of 4 cm."""
    tracer = open_tracer(world)
    given: dict[str, Any] = {"pattern": ONE, "half_angle_rad": (0, 0), "sub_rays": 1, **values}
    instrument = Instrument(pulse_j=1e-6, aperture_radius_m=0.02, **given)
    found = scan_whole(world, tracer, instrument, pose, laws)
    tracer.close()
    return found


@pytest.mark.parametrize("distance_m", [0.1, 7.3, 1e4])
@pytest.mark.parametrize("incidence_deg", [0, 45, 85])
def test_range_and_energy_of_a_ray_on_a_plane(distance_m, incidence_deg):
    world = plane(distance_m, incidence_deg)
    found, truth, cosine = measure(world), distance_on_axis(world), np.cos(np.radians(incidence_deg))
    assert truth == pytest.approx(distance_m, rel=1e-4)
    assert found.range_m == pytest.approx([truth], rel=5e-7)
    assert found.true_range_m == pytest.approx([truth], rel=5e-7)
    assert found.point_m[0] == pytest.approx([truth, 0, 0], abs=5e-7 * distance_m)
    # The corners of the plane are in single precision.
    assert np.degrees(found.incidence_rad) == pytest.approx([incidence_deg], abs=1e-4)
    assert found.energy_j == pytest.approx([1e-6 * np.pi * 0.02**2 * 0.7 / np.pi * cosine / truth**2], rel=1e-5)
    assert found.number.tolist() == [7]


@pytest.mark.parametrize("rays", [20, 60])
@pytest.mark.parametrize("half_angle_mrad", [10, 30])
@pytest.mark.parametrize("incidence_deg", [0, 45, 70])
def test_energy_of_a_beam_on_a_tilted_plane(rays, half_angle_mrad, incidence_deg):
    world, half = plane(10, incidence_deg), half_angle_mrad * 1e-3
    one, beam = measure(world), measure(world, half_angle_rad=(half, half), sub_rays=rays)
    formula = 1 + 3 * (half / 2) ** 2 * (np.tan(np.radians(incidence_deg)) ** 2 - 1)
    assert beam.energy_j / one.energy_j == pytest.approx([formula], rel=1e-5)
    assert beam.share == pytest.approx([1.0])
    assert beam.true_range_m == one.range_m


def test_a_wide_beam_on_a_grazing_plane_is_one_long_return():
    found = measure(plane(100, 85), half_angle_rad=(5e-3, 5e-3), sub_rays=20)
    assert len(found) == 1
    # The standard deviation of range is R s tan i, and more by the second order.
    assert found.spread_m[0] == pytest.approx(100 * 2.5e-3 * np.tan(np.radians(85)), rel=0.1)
    assert found.true_range_m == pytest.approx([100], rel=1e-4)  # the corners are rounded


def test_a_ray_past_85_degrees_still_returns():
    found = measure(plane(5, 89.9))
    assert found.range_m == pytest.approx([5], rel=1e-5)
    assert 0 < found.energy_j[0] < 2e-3 * measure(plane(5, 0)).energy_j[0]


def test_an_edge_gives_two_returns_that_share_the_energy():
    """The upper half of a beam meets a wall at 5 m, the lower half one at 8 m."""
    near = shape([[5, -9, 0], [5, 9, 0], [5, 9, 9], [5, -9, 9]], [[0, 1, 2], [0, 2, 3]])
    far = shape([[8, -9, -9], [8, 9, -9], [8, 9, 9], [8, -9, 9]], [[0, 1, 2], [0, 2, 3]], label=2)
    world = World([Placed(near, np.eye(4)[None], np.array([1])), Placed(far, np.eye(4)[None], np.array([2]))])
    found = measure(world, half_angle_rad=(2e-3, 2e-3), sub_rays=60)
    whole = measure(world).energy_j[0] if not len(found) else measure(plane(5, 0)).energy_j[0]
    assert found.range_m == pytest.approx([5, 8], rel=1e-5)
    assert found.energy_j / [whole, whole * 25 / 64] == pytest.approx([0.5, 0.5], abs=0.02)
    assert found.share == pytest.approx([0.5, 0.5], abs=0.02)
    assert found.of.tolist() == [2, 2]
    assert found.number.tolist() == [1, 2]
    assert found.label.tolist() == [1, 2]
    assert found.on_axis.sum() == 1
    assert measure(world, half_angle_rad=(2e-3, 2e-3), sub_rays=60, reported="LAST").range_m == pytest.approx([8])


def test_a_pose_turns_and_moves_the_scan():
    """The same plane from a moved and turned sensor: equal ranges, points that fit the world."""
    pose = SensorPose(np.array([2000.0, -300, 40]), from_vector(np.array([0.4, 0.2, -1.3])))
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = pose.rotation, pose.position_m
    home = plane(6, 50)
    moved = World([Placed(home.placed[0].shape, place[None], np.array([7]))])
    values: dict[str, Any] = {
        "pattern": ScanPattern("FLASH", 3, 4, 20, 10),
        "half_angle_rad": (1e-3, 1e-3),
        "sub_rays": 20,
    }
    first, second = measure(home, **values), measure(moved, pose, **values)
    assert second.beam.tolist() == list(range(12))
    assert second.range_m == pytest.approx(first.range_m, rel=5e-7)
    assert second.energy_j == pytest.approx(first.energy_j, rel=3e-6)
    assert pose.to_sensor(second.point_m) == pytest.approx(first.point_m, abs=1e-5)
    assert second.normal @ pose.rotation == pytest.approx(first.normal, abs=1e-6)


def test_a_sensor_in_a_mesh_meets_its_inner_wall():
    found = measure(World([Placed(BOX, np.eye(4)[None], np.array([5]))]))
    assert found.range_m == pytest.approx([1])
    assert found.normal[0] == pytest.approx([-1, 0, 0])
    assert found.number.tolist() == [5]


def test_nothing_in_sight_nothing_in_range_and_no_light():
    behind = plane(-5, 0)
    assert not len(measure(behind))
    assert not len(measure(World([])))
    assert not len(measure(plane(5, 0), nearest_m=6))
    assert not len(measure(plane(5, 0), farthest_m=4))
    black = {1: tabulate_backscatter(lunar_lambert(0.0, 0.0))}
    assert not len(measure(plane(5, 0), laws=black))
    white = {1: tabulate_backscatter(lunar_lambert(1.0, 0.0))}
    assert measure(plane(5, 0), laws=white).energy_j == pytest.approx([1e-6 * 0.02**2 / 25], rel=1e-6)


def test_a_surface_that_is_too_near_hides_what_is_behind_it():
    near, far = plane(1, 0), plane(5, 0)
    assert not len(measure(World([*near.placed, *far.placed]), nearest_m=2))


def test_a_surface_without_a_law_is_one_sentence():
    with pytest.raises(IcyMoonError, match="label 1, which has no law"):
        measure(plane(5, 0), laws={})


def test_batches_give_the_same_bits_and_bounded_pieces(monkeypatch):
    world = block_field(30, 4, side=40)
    pose, tracer = make_pose((0, 0, 1.5), (1, 0, 0, 0)), open_tracer(world)
    pattern = ScanPattern("SPINNING", 8, 40, 360, 20, -25)
    instrument = Instrument(pattern, 1e-6, (5e-3, 5e-3), 0.02, sub_rays=20)
    whole = scan_whole(world, tracer, instrument, pose, LAMBERT)
    monkeypatch.setattr(lidar, "_RAYS_AT_ONCE", 16 * 21)
    parts = list(scan(world, tracer, instrument, pose, LAMBERT))
    tracer.close()
    assert len(parts) == 20
    assert max(len(np.unique(part.beam)) for part in parts) <= 16
    joined = join_returns(parts)
    for name in ("beam", "order", "range_m", "energy_j", "point_m", "normal", "number"):
        assert np.array_equal(getattr(joined, name), getattr(whole, name))
    assert set(np.unique(whole.number)) - {1}


def test_a_scan_is_measured_beside_its_returns():
    """Without ice and detector the returns are the same; with them, the truth is, and more lies beside it."""
    world, pattern = plane(10, 60), ScanPattern("FLASH", 4, 5, 20, 20)
    tracer = open_tracer(world)
    instrument = Instrument(pattern, 1e-6, (1e-3, 1e-3), 0.02, farthest_m=50.0)
    whole = scan_whole(world, tracer, instrument, HOME, LAMBERT)
    (bare,) = scan_and_measure(world, tracer, instrument, HOME, LAMBERT, Sensing({}))
    assert all(np.array_equal(value, getattr(whole, name)) for name, value in vars(bare.returns).items())
    assert (bare.beside, bare.alarms, bare.beams, bare.empty) == ({}, None, 20, 20 - len(whole))
    sensing = Sensing({1: make_snow(1e-3, 500.0, 532.0)}, AnalogReceiver(Apd(), threshold=2.0))
    (late,) = scan_and_measure(world, tracer, instrument, HOME, LAMBERT, sensing)
    digitiser = make_digitiser(AnalogReceiver(Apd(), threshold=2.0), instrument, 64)
    (heard,) = scan_and_measure(world, tracer, instrument, HOME, LAMBERT, sensing, digitiser=digitiser)
    tracer.close()
    assert np.array_equal(late.returns.range_m, whole.range_m)
    # The threshold of a strong return is at the foot of its edge, where less of the delay is.
    assert 0.01 < np.mean(late.beside["measured_range_m"] - whole.range_m) < 0.032
    assert late.beside["ice_edge_m"] == pytest.approx(np.full(len(whole), 0.032), abs=0.001)
    assert late.alarms is not None
    # An alarm lies on the axis of its beam, at its range.
    axis = pattern.make_beams().direction[late.alarms.beam]
    assert len(axis)
    assert late.alarms.point_m == pytest.approx(axis * late.alarms.range_m[:, None])
    # Waveforms change nothing else.
    assert late.packets is None
    assert all(np.array_equal(late.beside[name], values, equal_nan=True) for name, values in heard.beside.items())
    assert heard.alarms is not None
    assert np.array_equal(late.alarms.range_m, heard.alarms.range_m)
    assert heard.packets is not None
    assert heard.packets.returns.packet.shape == (len(whole),)
    assert heard.packets.alarms.packet.shape == late.alarms.beam.shape


@pytest.mark.long
def test_twenty_rays_find_on_blocks_what_2401_find():
    found = compare_with_many_rays(20, ScanPattern("RASTER", 50, 80, 90, 30, -25))
    assert found.energy_rms <= 0.03
    assert found.found_share >= 0.9
    assert found.false_share <= 0.005
    assert found.clear > 100
