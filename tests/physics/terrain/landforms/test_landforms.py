"""Every landform against the law that its settings state."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from icymoon.physics.terrain.landforms import MAKERS, Landform, craters, ridges
from icymoon.physics.terrain.terrain import make_terrain, snow_depth_m
from icymoon.settings.description import defaults, merged
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError


def _made(topic: str, seed: int = 1, size_m: float = 20.0, **changes: Any) -> Landform:
    made = MAKERS[topic](merged(defaults(), {topic: changes})[topic], np.random.default_rng(seed), size_m)
    assert made is not None
    return made


def _grid(landform: Landform, size_m: float, n: int, shortest_m: float = 0.0) -> tuple[Array, float]:
    """Heights on a grid (row: north, column: east), and its spacing."""
    axis = np.linspace(-size_m / 2, size_m / 2, n)
    return np.array(landform.heights(axis[None, :], axis[:, None], shortest_m)), axis[1] - axis[0]


def _turned(landform: Landform, azimuth_deg: float, size_m: float, n: int) -> tuple[Array, float]:
    """The same along (row) and to the right of (column) an azimuth."""
    axis = np.linspace(-size_m / 2, size_m / 2, n)
    right, along = np.meshgrid(axis, axis)
    sin, cos = math.sin(math.radians(azimuth_deg)), math.cos(math.radians(azimuth_deg))
    return landform.heights(sin * along + cos * right, cos * along - sin * right, 0.0), axis[1] - axis[0]


def test_every_landform_is_off_until_it_is_asked_for():
    assert [make(defaults()[topic], np.random.default_rng(0), 20.0) for topic, make in MAKERS.items()] == [None] * 7


# --- penitentes -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("azimuth", [0.0, 40.0, 180.0])
@pytest.mark.parametrize("spacing", [0.7, 1.5])
def test_rows_of_penitentes_have_the_stated_spacing_across_the_noon_sun(azimuth, spacing):
    made = _made("penitentes", height_m=1.0, spacing_m=spacing, noon_azimuth_deg=azimuth, variation=0.3)
    heights, step = _turned(made, azimuth, 40.0, 641)

    def spectrum(axis: int) -> Array:
        lines = heights - heights.mean()
        window = np.hanning(len(lines))
        lines = lines * (window[:, None] if axis == 0 else window[None, :])
        return (np.abs(np.fft.rfft(lines, axis=axis)) ** 2).mean(axis=1 - axis)

    waves = np.fft.rfftfreq(641, step)
    toward, along = spectrum(0), spectrum(1)
    band = (waves > 0.5 / spacing) & (waves < 1.5 / spacing)
    centre = np.average(waves[band], weights=toward[band])
    # Rows wander by half a spacing, which smears the line but does not move its centre.
    assert centre == pytest.approx(1 / spacing, rel=0.05)
    assert toward[band].sum() > 3 * along[band].sum()


def test_penitentes_stand_at_the_stated_height_on_concave_walls():
    for sharpness in (0.0, 0.5, 1.0):
        heights, _ = _grid(
            _made("penitentes", height_m=2.0, spacing_m=1.0, sharpness=sharpness, variation=0.0), 10.0, 501
        )
        assert heights.max() == pytest.approx(2.0, rel=0.02)  # a vertex is up to 1 cm from a crest
        assert heights.min() == pytest.approx(0.0, abs=1e-3)
        # The mean of a smooth step is 1/2, of a parabola between edges 1/3.
        assert heights.mean() == pytest.approx(2.0 * (1 / 2 - sharpness / 6), rel=0.03)
    broken, _ = _grid(_made("penitentes", height_m=2.0, variation=0.9), 10.0, 401)
    assert 1.0 < broken.max() <= 2.0
    assert broken.mean() < 0.6 * heights.mean()


@pytest.mark.parametrize("azimuth", [0.0, 250.0])
@pytest.mark.parametrize("lean", [0.0, 5.0, 20.0])
def test_blades_lean_toward_the_noon_sun(azimuth, lean):
    made = _made("penitentes", height_m=2.0, spacing_m=1.5, variation=0.0, noon_azimuth_deg=azimuth, lean_deg=lean)
    heights, _ = _turned(made, azimuth, 24.0, 801)
    rising = np.mean(np.diff(heights, axis=0) > 0)  # on the way toward noon
    # The crest is shifted by tan(lean) height over spacing, of which a height field shows at most 0.23.
    expected = 0.5 + min(math.tan(math.radians(lean)) * 2.0 / 1.5, 0.23)
    assert rising == pytest.approx(expected, abs=0.025)


@pytest.mark.parametrize("azimuth", [0.0, 70.0])
def test_rows_of_penitentes_wander_in_proportion_to_the_setting(azimuth):
    """The signed distance from a crest changes along a row by as much as the row wanders, and not at all in planes
    through the path of the Sun."""

    def drift(wander):
        made = _made("penitentes", height_m=2.0, spacing_m=1.0, noon_azimuth_deg=azimuth, wander=wander)
        assert made.crests is not None
        across, along = np.meshgrid(np.linspace(-9.0, 9.0, 61), np.linspace(-9.0, 9.0, 61))
        sin, cos = math.sin(math.radians(azimuth)), math.cos(math.radians(azimuth))

        def distance(t):  # a row runs at right angles to the azimuth
            return made.crests.lines[0](sin * across + cos * (along + t), cos * across - sin * (along + t))

        change = (distance(1e-4) - distance(0.0)) / 1e-4
        return np.sqrt(np.mean(np.square(change[np.abs(change) < 100.0])))  # not where the next row begins

    none, little, usual = (drift(wander) for wander in (0.0, 0.1, 0.5))
    assert none < 1e-9
    assert usual == pytest.approx(5.0 * little, rel=0.05)
    assert usual > 0.3


def test_disorder_gives_groups_of_different_heights_at_the_same_tallest():
    mades = [_made("penitentes", height_m=2.0, spacing_m=1.0, variation=0.0, disorder=d) for d in (0.0, 1.0)]
    even, mixed = (_grid(made, 40.0, 801)[0] for made in mades)
    # The tallest of squares two spacings wide: in even rows each has a crest of 2 m.
    tallest = [h[:800, :800].reshape(20, 40, 20, 40).max(axis=(1, 3)) for h in (even, mixed)]
    assert tallest[0].min() > 1.9
    assert 1.9 < tallest[1].max() <= 2.0
    assert tallest[1].min() < 1.0
    assert tallest[1].std() > 0.2


def test_a_coarse_mesh_gets_rounder_blades_not_saws():
    made = _made("penitentes", height_m=2.0, spacing_m=1.0, variation=0.0)
    fine, coarse = (_grid(made, 10.0, 501, shortest)[0] for shortest in (0.0, 0.3))
    assert np.abs(np.diff(coarse, 2, axis=0)).max() < 0.5 * np.abs(np.diff(fine, 2, axis=0)).max()
    assert coarse.max() == pytest.approx(2.0, rel=0.02)


# --- double ridges ----------------------------------------------------------------------------------------------------


def test_the_profile_of_a_double_ridge():
    place = np.linspace(-1.2, 1.2, 2401)
    heights = ridges.ridge_profile(place, 0.4)
    assert heights[1200] == pytest.approx(0.6)  # the trough is 0.4 deep
    assert heights.max() == pytest.approx(1.0)
    assert np.allclose(np.abs(place[heights > 0.9999]), 0.4, atol=1e-3)  # two crests
    assert np.all(heights[np.abs(place) >= 1.0] == 0.0)
    assert np.abs(np.diff(heights)).max() < 0.01  # no steps
    assert np.allclose(heights, heights[::-1])


@pytest.mark.parametrize("azimuth", [0.0, 60.0])
def test_ridges_have_the_stated_height_trough_width_and_direction(azimuth):
    made = _made(
        "ridges", height_m=0.5, width_m=2.0, spacing_m=6.0, trough=0.4, sets=1, azimuth_deg=azimuth, spread_deg=0.0
    )
    heights, step = _turned(made, azimuth, 80.0, 1201)
    assert heights.max() == pytest.approx(0.5, rel=0.01)
    middle = heights[len(heights) // 2]
    starts, ends = (
        np.flatnonzero(np.diff((middle > 0).astype(int)) == 1),
        np.flatnonzero(np.diff((middle > 0).astype(int)) == -1),
    )
    ends = ends[ends > starts[0]]
    widths = (ends[: len(starts)] - starts[: len(ends)]) * step
    # Ridges wander by 0.12 spacings over 2.5: a cut square to the mean direction is up to a tenth longer or shorter.
    assert np.allclose(widths, 2.0, rtol=0.12)
    assert len(starts) == pytest.approx(80 / 6, abs=1.5)
    for start, end in zip(starts, ends, strict=False):
        across = middle[start:end]
        trough = across[len(across) // 4 : -len(across) // 4].min()
        assert trough == pytest.approx(0.5 * (1 - 0.4), rel=0.06)
    along, right = (np.square(np.diff(heights, axis=k)).mean() for k in (0, 1))
    assert right > 10 * along


def test_young_ridges_bury_old_ones_instead_of_standing_on_them():
    one, many = (
        _grid(_made("ridges", height_m=1.0, width_m=3.0, spacing_m=4.0, sets=sets), 60.0, 601)[0] for sets in (1, 6)
    )
    assert many.max() < 1.1 * one.max()
    assert many.min() >= 0.0
    assert np.mean(many > 0) > np.mean(one > 0)


# --- cracks -----------------------------------------------------------------------------------------------------------


def test_cracks_have_the_stated_depth_width_and_rims():
    made = _made("cracks", depth_m=0.5, width_m=0.2, rim_m=0.1, plate_m=3.0)
    heights, step = _grid(made, 30.0, 1001)
    assert heights.min() == pytest.approx(-0.5, rel=0.02)
    assert heights.max() == pytest.approx(0.1, rel=0.01)
    # Random cells have 2 m of edge per square metre and root density (Meijering 1953: Poisson points), somewhat less
    # where each square has one point. A crack is as wide as stated, its rims reach one width further, less at corners.
    inside = np.mean(_grid(_made("cracks", depth_m=0.5, width_m=0.2, plate_m=3.0), 30.0, 1001)[0] < 0)
    assert inside == pytest.approx(0.2 * 2.0 / 3.0, rel=0.12)
    touched = np.mean(heights != 0)
    assert touched / inside == pytest.approx(2.85, rel=0.06)
    # No steps, also where three cracks meet: a smooth step of 0.6 m over half a width is at most 1.5 times as steep
    # as a straight one, and bending brings neighbouring places up to half as close again.
    steepest = 1.5 * 0.6 / 0.1 * 1.5
    assert max(np.abs(np.diff(heights, axis=k)).max() for k in (0, 1)) < steepest * step


def test_long_plates_make_sub_parallel_cracks():
    made = _made("cracks", depth_m=0.5, width_m=0.2, plate_m=1.5, elongation=8.0, azimuth_deg=30.0)
    heights, _ = _turned(made, 30.0, 40.0, 1001)
    along, right = (np.square(np.diff(heights, axis=k)).mean() for k in (0, 1))
    assert right > 5 * along
    assert np.mean(heights < -0.25) > 0.05


@pytest.mark.long
def test_broken_cracks_are_steeper_than_rounded_ones_and_hold_fallen_fragments():
    asked: dict[str, Any] = {"depth_m": 0.5, "width_m": 0.4, "plate_m": 3.0}
    rounded, broken = (_grid(_made("cracks", edges=edges, **asked), 16.0, 1601) for edges in ("ROUNDED", "BROKEN"))
    step = rounded[1]
    # As deep as stated, and as wide but for chips, which reach 0.4 of their width into the plate.
    assert broken[0].min() == pytest.approx(-0.5, rel=0.02)
    inside = [np.mean(heights < 0) for heights, _ in (rounded, broken)]
    assert 1.0 < inside[1] / inside[0] < 1.0 + 0.4 * (1.1 + 0.3)
    # Walls take 0.35 of the half width instead of all of it; ledges are less steep in part.
    middle = [np.abs(heights + 0.2) < 0.1 for heights, _ in (rounded, broken)]
    slopes = [
        np.median(np.hypot(*np.gradient(heights, step))[where])
        for (heights, _), where in zip((rounded, broken), middle, strict=True)
    ]
    assert slopes[1] > 1.25 * slopes[0]
    # Fallen fragments cover the floor, and none reaches out of the crack.
    assert np.mean(broken[0][broken[0] < -0.3] > -0.49) > 0.5
    assert broken[0].max() <= 1e-12


# --- chaos ------------------------------------------------------------------------------------------------------------


def test_plates_stand_at_the_stated_share_and_relief():
    for share in (0.0, 0.3, 1.0):
        heights, _ = _grid(
            _made("chaos", relief_m=0.5, plate_m=4.0, plate_share=share, gap_m=0.0, tilt_deg=0.0), 160.0, 601
        )
        # 1600 plates: a standard error of 0.012.
        assert np.mean(heights > 0) == pytest.approx(share, abs=0.04)
        assert heights.min() == pytest.approx(0.0, abs=1e-6)
    tops = heights[heights > 0.25]
    assert heights.max() == pytest.approx(0.5, rel=0.01)
    # Tops are even between half the relief and all of it; scarps below that.
    assert np.mean(tops > 0.375) == pytest.approx(0.5, abs=0.06)


@pytest.mark.long
def test_plates_are_tilted_as_stated_between_gaps_and_a_lumpy_matrix():
    heights, step = _grid(
        _made("chaos", relief_m=0.1, plate_m=4.0, plate_share=1.0, gap_m=0.0, tilt_deg=10.0), 80.0, 1001
    )
    slopes = np.stack(np.gradient(heights, step))
    flat = np.abs(np.gradient(slopes[0], step)[0]) < 0.05  # tops, not scarps
    # Uniform between -10 and 10 degrees' slope; the bending of the plates stretches it by up to a sixth.
    expected = math.tan(math.radians(10.0)) / math.sqrt(3)
    assert slopes[0][flat].std() == pytest.approx(expected, rel=0.2)
    wide, narrow = (
        np.mean(_grid(_made("chaos", relief_m=0.1, plate_share=1.0, gap_m=gap, tilt_deg=0.0), 80.0, 1001)[0] == 0)
        for gap in (0.4, 0.2)
    )
    assert narrow == pytest.approx(0.2 * 2.0 / 4.0, rel=0.15)  # gap times edges per area
    assert wide == pytest.approx(2 * narrow, rel=0.1)
    matrix, _ = _grid(_made("chaos", relief_m=0.0, plate_share=0.0, matrix_m=0.3), 120.0, 601)
    assert matrix.std() == pytest.approx(0.3, rel=0.05)


def _curvatures(edges):
    heights, step = _grid(_made("chaos", relief_m=0.0, plate_share=0.0, matrix_m=0.3, edges=edges), 4.0, 1001)
    return np.diff(heights, 2, axis=0).ravel() / step**2


@pytest.mark.long
def test_broken_chaos_is_of_flat_faces_that_meet_at_edges():
    """Curvature is in the edges: its kurtosis is far above the 3 of a Gaussian field, which the lumps are near."""
    lumps, blocks = (_curvatures(edges) for edges in ("ROUNDED", "BROKEN"))
    kurtosis = [np.mean(c**4) / np.mean(c**2) ** 2 for c in (lumps, blocks)]
    assert kurtosis[0] < 6.0 < 12.0 < kurtosis[1]
    # Most of each face is plane.
    assert (
        np.mean(np.abs(blocks) < 0.01 * np.abs(blocks).max())
        > 0.5
        > 0.2
        > np.mean(np.abs(lumps) < 0.01 * np.abs(lumps).max())
    )


@pytest.mark.long
def test_broken_plates_have_steep_scarps_and_a_matrix_of_the_stated_height():
    heights, step = _grid(
        _made("chaos", relief_m=1.0, plate_m=4.0, plate_share=1.0, gap_m=0.3, tilt_deg=0.0, edges="BROKEN"), 16.0, 1201
    )
    slope = np.hypot(*np.gradient(heights, step))
    scarp = slope > 1.0
    # A plate of relief 0.5 to 1 m rises over 1 m / tan(80 degrees).
    assert math.radians(70.0) < math.atan(np.median(slope[scarp])) < math.radians(83.0)
    # Tops and ledges are level right up to their rims: no rounding but that of one step of the grid.
    assert np.mean((slope > 0.01) & (slope < 1.0)) < 0.2 * np.mean(scarp)
    matrix, _ = _grid(_made("chaos", relief_m=0.0, plate_share=0.0, matrix_m=0.3, edges="BROKEN"), 80.0, 601)
    assert matrix.std() == pytest.approx(0.3, rel=0.05)


@pytest.mark.long
def test_edges_of_plates_lose_no_more_than_their_chips():
    """Broken plates are those of straight cells, less the gap, the scarp and chips of at most 0.4 of their width."""
    whole, broken = (
        _grid(
            _made("chaos", relief_m=1.0, plate_m=4.0, plate_share=1.0, gap_m=gap, tilt_deg=0.0, edges="BROKEN"),
            60.0,
            801,
        )[0]
        for gap in (0.0, 0.3)
    )
    assert (broken <= whole + 1e-12).all()
    lost = np.mean(whole > 0) - np.mean(broken > 0)
    assert lost == pytest.approx(0.3 * 2.0 / 4.0, rel=0.25)  # gap times edges per area


# --- hollows ----------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_crests_between_hollows_are_as_round_as_stated():
    """Across a crest the slope turns over the stated width instead of at once; the floor of a hollow stays as it is."""
    sharp, round_ = (
        _grid(_made("hollows", depth_m=0.2, diameter_m=1.0, crest_m=crest), 3.0, 1501)[0] for crest in (0.0, 0.05)
    )
    assert (sharp.min(), sharp.max()) == pytest.approx((round_.min(), round_.max()), abs=2e-3)
    assert np.abs(sharp - round_).max() < 3.0 * 0.2 * 0.05 + 1e-3  # how deep it is half a width beside the edge
    # A kink turns the slope by it all at once, a crest of 5 cm over 25 steps of 2 mm; corners keep some of it.
    turn = [np.quantile(np.abs(np.diff(heights, 2, axis=1)), 0.999) for heights in (sharp, round_)]
    assert turn[1] < 0.3 * turn[0]


def test_hollows_have_the_stated_depth_and_number():
    heights, _ = _grid(_made("hollows", depth_m=0.2, diameter_m=1.0), 30.0, 1001)
    assert heights.max() == pytest.approx(0.0, abs=2e-3)
    assert heights.min() == pytest.approx(-0.2, rel=0.02)
    inner = heights[1:-1, 1:-1]
    lowest = np.ones(inner.shape, bool)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            if i or j:
                lowest &= inner < heights[1 + i : 1 + i + inner.shape[0], 1 + j : 1 + j + inner.shape[1]]
    # One hollow per square diameter; those whose point is in the wrong place lie at the edge of the grid.
    assert lowest.sum() == pytest.approx(30.0**2, rel=0.05)
    assert np.mean(inner[lowest] < -0.6 * 0.2 + 5e-3) > 0.97  # the shallowest is 0.6 as deep


# --- pits ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("coverage", [0.1, 0.4, 0.8])
def test_pits_cover_their_share_of_the_ground(coverage):
    """On 60 m squared, some 400 pits at 0.4: a share within 5 % by chance, and 3 % for the measured law of squares."""
    heights, _ = _grid(_made("pits", depth_m=0.5, diameter_m=2.0, coverage=coverage), 60.0, 601)
    assert np.mean(heights < 0.0) == pytest.approx(coverage, rel=0.1)


@pytest.mark.long
def test_pits_have_flat_floors_at_one_depth_steep_walls_and_no_raised_rims():
    heights, step = _grid(_made("pits", depth_m=0.5, diameter_m=2.0, coverage=0.3, wall_deg=60.0), 20.0, 2001)
    assert heights.max() == 0.0
    assert heights.min() == pytest.approx(-0.5)
    inside = heights[heights < 0.0]
    # Walls are 0.29 m wide: half the area of a pit of 1 m radius; blocks of the lag stand on the floor.
    assert np.mean(inside == -0.5) > 0.2
    assert np.mean(inside < -0.5 * 0.87) > 0.35
    slope = np.hypot(*np.gradient(heights, step))
    wall = (heights < -0.1) & (heights > -0.35)
    # Bent walls are as much steeper and gentler as their lines are closer and wider apart.
    assert np.degrees(np.arctan(np.median(slope[wall]))) == pytest.approx(60.0, abs=5.0)


def test_pits_that_meet_share_one_floor_between_cusps():
    """Pits grow sideways at one depth: where two overlap, nothing stands between them, however many overlap."""
    few, many = (
        _grid(_made("pits", depth_m=0.5, diameter_m=2.0, coverage=share), 30.0, 601)[0] for share in (0.1, 0.7)
    )
    assert few.min() == many.min() == pytest.approx(-0.5)


@pytest.mark.long
def test_talus_lies_at_the_foot_of_walls_at_its_angle_of_repose():
    bare, dressed = (
        _grid(_made("pits", depth_m=0.5, diameter_m=2.0, coverage=0.3, wall_deg=75.0, talus=share), 10.0, 1001)
        for share in (0.0, 0.25)
    )
    added, step = dressed[0] - bare[0], bare[1]
    assert added.min() >= 0.0
    assert (added[bare[0] == 0.0] == 0.0).all()  # none on the plain
    talus = added > 0.02
    inside = bare[0] < 0.0
    assert 0.1 < talus[inside].mean() < 0.6
    # Aprons of about a quarter of the depth, higher and lower along a wall, and never up to the rim.
    assert 0.1 < np.quantile(added, 0.999) < 0.35
    assert dressed[0][talus].max() < -0.1
    slope = np.degrees(np.arctan(np.hypot(*np.gradient(dressed[0], step))))
    # Bent walls make lines closer and wider apart; debris makes the slope uneven, with as much up as down.
    assert np.median(slope[talus & (added > 0.06)]) == pytest.approx(35.0, abs=5.0)


@pytest.mark.long
def test_talus_has_no_step_where_it_ends():
    heights, step = _grid(_made("pits", depth_m=0.5, diameter_m=2.0, coverage=0.3, wall_deg=75.0, talus=0.5), 4.0, 1601)
    # Sides of debris and bent walls are steep; a step of a centimetre would be a slope of 4.
    assert np.abs(np.diff(heights, axis=0)).max() / step < 8.0
    floor = heights < -0.45
    beside = np.abs(np.diff(heights, axis=0))[floor[1:] & floor[:-1]]
    assert beside.max() / step < 3.5


def test_hollows_can_be_long():
    made = _made("hollows", depth_m=0.2, diameter_m=0.5, elongation=6.0, azimuth_deg=75.0)
    heights, _ = _turned(made, 75.0, 20.0, 801)
    along, right = (np.square(np.diff(heights, axis=k)).mean() for k in (0, 1))
    assert right > 5 * along


# --- craters ----------------------------------------------------------------------------------------------------------


def test_the_profile_of_a_crater():
    r = np.linspace(0, 3.5, 3501)
    heights = craters.crater_profile(r, 0.2, 0.04)
    assert heights[0] == pytest.approx(0.04 - 0.2)
    assert heights.max() == pytest.approx(0.04)
    assert r[np.argmax(heights)] == pytest.approx(1.0, abs=1e-3)
    assert np.all(heights[r >= 3] == 0)
    assert heights[2000] == pytest.approx(0.04 * (1 / 8 - 1 / 27) / (1 - 1 / 27))  # ejecta thin as the cube
    assert np.abs(np.diff(heights)).max() < 0.001


def _law(**changes: Any) -> Array:
    return craters.draw_craters(merged(defaults(), {"craters": changes}).craters, np.random.default_rng(3), 100.0)


@pytest.mark.parametrize("index", [1.5, 2.0, 3.5])
def test_crater_sizes_follow_the_truncated_power_law(index):
    _, _, size, fresh = _law(coverage=0.2, smallest_m=0.4, largest_m=5.0, power_index=index, freshness=0.3, most=50_000)
    assert size.min() >= 0.4
    assert size.max() <= 5.0
    assert np.all(np.diff(size) <= 0)
    low, high = 0.4**-index, 5.0**-index
    smaller = (low - np.sort(size) ** -index) / (low - high)  # the law's distribution function, should be even
    even = (np.arange(len(size)) + 0.5) / len(size)
    # Kolmogorov-Smirnov at the 0.1 % level.
    assert np.abs(smaller - even).max() < 1.95 / math.sqrt(len(size))
    area = (100.0 + 3.0 * 5.0) ** 2
    scatter = math.sqrt(np.square(size**2).sum()) / np.sum(size**2)  # of a sum of so many areas
    assert math.pi / 4 * np.sum(size**2) / area == pytest.approx(0.2, rel=4 * scatter)
    assert fresh.min() >= 0.3
    assert fresh.max() <= 1.0


def test_a_crater_is_as_deep_as_stated_and_the_small_wipe_out_the_large():
    changes = {
        "coverage": 0.15,
        "smallest_m": 1.0,
        "largest_m": 4.0,
        "freshness": 0.5,
        "depth_ratio": 0.2,
        "rim_ratio": 0.05,
    }
    made = _made("craters", seed=3, size_m=100.0, **changes)
    x, y, size, fresh = _law(**changes)
    checked = 0
    for k in range(len(x)):
        later = slice(k + 1, None)
        # Those on the patch (beyond it, craters of its other side come in) that no later crater reaches.
        on_patch = max(abs(x[k]), abs(y[k])) + size[k] / 2 < 50.0
        if on_patch and np.all(np.hypot(x[later] - x[k], y[later] - y[k]) > 1.5 * size[later] + size[k]):
            angle = np.linspace(0, 2 * math.pi, 8)
            centre = made.heights(x[k : k + 1], y[k : k + 1], 0.0)[0]
            assert centre == pytest.approx((0.05 - 0.2) * size[k] * fresh[k], abs=1e-12)
            if np.all(np.hypot(x[:k] - x[k], y[:k] - y[k]) > 1.5 * size[:k] + size[k] / 2):
                rim = made.heights(x[k] + size[k] / 2 * np.cos(angle), y[k] + size[k] / 2 * np.sin(angle), 0.0)
                assert np.allclose(rim, 0.05 * size[k] * fresh[k])
                checked += 1
    assert checked > 20


def test_craters_that_cannot_be():
    with pytest.raises(IcyMoonError, match=r"craters\.smallest_m"):
        _law(coverage=0.1, smallest_m=5.0, largest_m=1.0)
    with pytest.raises(IcyMoonError, match=r"craters\.most"):
        _law(coverage=0.5, smallest_m=0.01)


# --- mantle -----------------------------------------------------------------------------------------------------------


def test_the_law_of_the_snow():
    below = np.linspace(-1.0, 3.0, 4001)
    snow = snow_depth_m(below, 0.5)
    assert np.all(snow[below <= 0] == 0.0)  # nothing on heights
    assert np.all(snow[below >= 1.0] == 0.5)  # the stated thickness in deep hollows
    assert np.all(snow <= np.maximum(below, 0.0))  # never above the surroundings
    assert np.all(np.diff(snow) >= 0)
    assert np.all(np.diff(below - snow) >= 0)  # what was lower stays lower
    assert np.allclose(snow_depth_m(below, 1e9), np.maximum(below, 0.0))  # all the snow there is fills to the brim
    assert np.all(snow_depth_m(below, 0.0) == 0.0)
    # Snow starts with a crease, but where it gets as thick as it can there is none: its curvature is at most 1/2T.
    assert np.abs(np.diff(snow, 2))[below[1:-1] > 0.01].max() < 1.01e-6 / (2 * 0.5)


@pytest.mark.parametrize("feather", [0.02, 0.3, 1.0])
def test_feathered_snow_thins_out_without_a_crease(feather):
    below = np.linspace(-2.0, 3.0, 5001)
    step, sharp, soft = below[1] - below[0], snow_depth_m(below, 0.5), snow_depth_m(below, 0.5, feather)
    beyond = np.abs(below) > feather + 1e-9
    assert np.array_equal(soft[beyond], sharp[beyond])  # the law is as before where the edge is not near
    assert np.all(soft[~beyond][1:-1] > sharp[~beyond][1:-1])
    assert np.all(soft[below < -feather] == 0.0)
    assert np.all(soft <= 0.5)
    assert np.all(np.diff(soft) >= 0)
    assert np.all(np.diff(below - soft) >= -1e-12)  # what was lower stays lower
    # No crease: the curvature is at most that of the start, 1/2w, plus that of the law, 1/2T.
    assert np.abs(np.diff(soft, 2)).max() <= (1 / (2 * feather) + 1 / (2 * 0.5)) * step**2 * (1 + 1e-6)
    at_edge = feather / 4
    assert snow_depth_m(np.zeros(1), 0.5, feather)[0] == pytest.approx(at_edge - at_edge**2 / 2)


def test_feathered_snow_damps_roughness_gradually_from_bare_to_buried_ground():
    """Waves of a millimetre on ground that falls from 0.1 m above to 0.1 m below the snow's surface."""
    below, wave = np.linspace(-0.1, 0.1, 41), 0.001
    crest, trough = (below + sign * wave - snow_depth_m(below + sign * wave, 1e6, 0.08) for sign in (1, -1))
    left = (crest - trough) / (2 * wave)  # share of the roughness that shows
    assert np.allclose(left[below < -0.082], 1.0)
    assert np.allclose(left[below > 0.082], 0.0, atol=1e-6)
    # The depth grows by (e + w)²/4w, so the share that is left falls linearly.
    inside = np.abs(below) < 0.078
    assert np.allclose(left[inside], (0.08 - below[inside]) / 0.16, atol=1e-3)


def test_a_feather_changes_the_ground_only_near_the_edge_of_its_snow():
    sharp, soft = (
        make_terrain(merged(defaults(), {"mantle": {"thickness_m": 0.2, "length_m": 2.0, "feather_m": w}}), 1)
        for w in (0.0, 0.05)
    )
    axis = np.linspace(-10, 10, 201)
    at = axis[None, :], axis[:, None]
    changed = soft.heights(*at) - sharp.heights(*at)
    assert changed.min() >= 0.0
    assert 0.9 * 0.05 / 4 < changed.max() <= 0.05 / 4 + 1e-12  # the most that the start of the snow rises by
    assert np.allclose(soft.measure_loose(*at) - sharp.measure_loose(*at), changed, atol=1e-12)  # all of it is loose
    assert 0.05 < np.mean(changed == 0.0) < 0.95


@pytest.mark.parametrize("thickness", [0.05, 0.5, 1000.0])
def test_snow_fills_hollows_and_never_raises_a_ridge(thickness):
    parts = {"terrain": {"rms_slope_deg": 20.0}, "ridges": {"height_m": 0.6, "sets": 1}}
    bare, mantled = (
        make_terrain(merged(defaults(), parts, {"mantle": {"thickness_m": t, "length_m": 2.0}}), 1)
        for t in (0.0, thickness)
    )
    axis = np.linspace(-10, 10, 401)
    before, after = (ground.heights(axis[None, :], axis[:, None]) for ground in (bare, mantled))
    snow = after - before
    assert snow.min() >= -1e-12
    assert snow.max() <= thickness + 1e-12
    assert snow.max() > min(0.9 * thickness, 0.2)
    # What stands out of the 2 m around it.
    sums = np.pad(before, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    around = (sums[40:, 40:] - sums[:-40, 40:] - sums[40:, :-40] + sums[:-40, :-40]) / 40**2
    above = before[20:-19, 20:-19] - around
    crests = above > np.quantile(above, 0.97)
    assert np.mean(snow[20:-19, 20:-19][crests] == 0.0) > 0.95
    rough_before, rough_after = (np.abs(np.diff(z, 2, axis=0)).mean() for z in (before, after))
    assert rough_after < rough_before
