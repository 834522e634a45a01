"""The states of an excavation: volumes, masses, and what is refused."""

import math

import numpy as np
import pytest
from icymoon.physics.excavation import dig_site as sites
from icymoon.physics.excavation.dig import ExcavationSeries
from icymoon.physics.excavation.scoop_paths import read_path
from icymoon.settings import description
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError

DUG = {"path": "LINE", "states": 4, "bite_m": 0.04, "length_m": 0.2, "cell_m": 0.005, "start_y_m": 0.1}


def complete(part: dict) -> Settings:
    return description.merged(description.defaults(), description.check(part, "test"))


def series(slope=0.0, **changes):
    settings = complete({"excavation": DUG | changes, "light": {"body": "EUROPA"}})
    site = sites.make_site(settings)
    ground = np.add.outer(slope * site.grid.north_m, 0.5 * slope * site.grid.east_m)
    return ExcavationSeries(site, settings.excavation, 1, ground)


def test_the_first_state_is_untouched():
    made = series()
    np.testing.assert_array_equal(made.at(0).layers.top, made.before_m)
    assert made.facts(0)["taken_m3"] == 0.0


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"cohesion_pa": 0.0},
        {"path": "ARC"},
        {"heaped_share": 0.3},
        {"heading_deg": 213.0, "heap_side": "LEFT"},
        {"bulking": 1.0},
    ],
)
def test_no_mass_comes_or_goes(changes):
    # Sums of 1e4 numbers in double precision.
    assert series(0.1, **changes).mass_error(3) < 1e-12


def test_each_bite_takes_its_prism():
    facts = series(chips_m=0.0, heading_deg=200.0).facts(3)
    # The edges of a turned prism cross cells of 5 mm, of which 16 places each are looked at.
    np.testing.assert_allclose(facts["taken_by_state_m3"][1:], 0.08 * 0.2 * 0.04, rtol=2e-3)
    assert facts["deepest_m"] == pytest.approx(0.12, abs=1e-9)


def test_the_heap_has_the_mass_of_the_trench_and_more_volume():
    facts = series(chips_m=0.0, bulking=1.5).facts(3)
    assert facts["mass_in_spoil_kg"] == pytest.approx(facts["mass_taken_kg"], rel=1e-12)
    assert facts["spoil_m3"] == pytest.approx(1.5 * facts["taken_m3"], rel=1e-12)
    assert facts["mass_taken_kg"] == pytest.approx(500.0 * facts["taken_m3"], rel=1e-12)


def test_walls_stand_by_cohesion_and_slide_without():
    standing, sliding = series().facts(3), series(cohesion_pa=0.0).facts(3)
    assert (standing["walls"], sliding["walls"]) == ("stand", "slide")
    assert sliding["slid_m3"] > 0.0 == standing["slid_m3"]
    top = series(cohesion_pa=0.0, bulking=1.0).at(3).layers.top
    north, east = np.gradient(top, 0.005)
    assert np.degrees(np.arctan(np.hypot(north, east))).max() < 40.5  # as of spoil, see test_relax
    walls = series(chips_m=0.0).at(3).layers.top
    assert np.abs(np.diff(walls, axis=1)).max() == pytest.approx(0.12, abs=1e-9)  # within one cell


def test_chips_are_heaped_too():
    facts = series(chips_m=0.01).facts(3)
    assert facts["chipped_m3"] > 0
    assert facts["mass_in_spoil_kg"] == pytest.approx(500.0 * (facts["taken_m3"] + facts["chipped_m3"]), rel=1e-12)


def test_the_scoop_keeps_what_is_not_heaped():
    facts = series(chips_m=0.0, heaped_share=0.25).facts(3)
    assert facts["mass_kept_kg"] == pytest.approx(0.75 * facts["mass_taken_kg"], rel=1e-12)


def test_the_patch_changes_by_what_spoil_gained():
    # Ground and spoil differ in density only, so the surface rises by the bulking of what was moved.
    facts = series(bulking=1.4).facts(3)
    moved = facts["taken_m3"] + facts["chipped_m3"]
    assert facts["change_in_patch_by_state_m3"][-1] == pytest.approx(0.4 * moved, rel=1e-9)


def test_a_state_does_not_depend_on_those_after_it():
    whole = series()
    whole.at(3)
    np.testing.assert_array_equal(series().at(2).layers.top, whole.at(2).layers.top)


@pytest.mark.long
def test_neither_trench_nor_heap_reach_the_rim():
    for changes in ({}, {"cohesion_pa": 0.0}, {"path": "ARC", "length_m": 0.0}, {"heap_side": "LEFT"}):
        made = series(0.05, **changes)
        moved = np.abs(made.at(3).layers.top - made.before_m)
        assert max(moved[0].max(), moved[-1].max(), moved[:, 0].max(), moved[:, -1].max()) == 0.0


def test_no_bite_digs_nothing():
    facts = series(bite_m=0.0).facts(3)
    assert facts["taken_m3"] == 0.0
    assert facts["mass_error"] == 0.0
    settings = complete({"excavation": DUG | {"bite_m": 0.0}})
    assert any("Nothing is dug" in each for each in sites.advise_on_excavation(settings))


def test_a_recorded_path_digs_what_a_line_digs(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text(
        "state,x_m,y_m,depth_m\n" + "".join(f"{k},0,0.1,{0.04 * k}\n{k},0,-0.1,{0.04 * k}\n" for k in (1, 2, 3)),
        encoding="utf-8",
    )
    made = series(path="RECORDED", file=str(file))
    np.testing.assert_allclose(made.facts(3)["taken_by_state_m3"], series().facts(3)["taken_by_state_m3"], rtol=0.01)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("state,x_m,y_m\n1,0,0\n", "no column depth_m"),
        ("state,x_m,y_m,depth_m\n0,0,0,0\n", "line 2"),
        ("state,x_m,y_m,depth_m\n1,0,zero,0\n", "line 2"),
        ("state,x_m,y_m,depth_m\n", "no line of numbers"),
        ("state,x_m,y_m,depth_m\n1,1e300,0,0\n", "line 2 is more than 10000 m"),
        ("state,x_m,y_m,depth_m\n1,0,0,1e30\n", "100 m deep"),
        ("state,x_m,y_m,depth_m\n1.5,0,0,0\n", "line 2"),
        ("state;x_m;y_m;depth_m\n1;0;0;0\n", "no column state"),
        ("", "no column state"),
        ("state,x_m,y_m,depth_m\n" + "1,0,0,0\n" * 20_001, "more than 20000 lines"),
    ],
)
def test_a_bad_path_is_refused(tmp_path, text, message):
    file = tmp_path / "path.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(IcyMoonError, match=message):
        read_path(file)


def reasons(**topics):
    return " ".join(sites.find_refusals(complete({"excavation": DUG} | topics)))


def test_what_cannot_be_dug_is_refused_in_a_sentence():
    assert "last of 3 states" in reasons(excavation=DUG | {"states": 3, "state": 3})
    assert "Ground from a file" in reasons(source={"kind": "HEIGHT_MAP"})
    assert "gravity of TITAN" in reasons(light={"body": "TITAN"})
    assert "beyond the 20 m patch" in reasons(excavation=DUG | {"start_x_m": 9.99}, mesh={"kind": "GRID"})
    assert "raise excavation.cell_m" in reasons(excavation=DUG | {"length_m": 10.0, "cell_m": 0.001})
    assert "mesh.farthest_m" in reasons(excavation=DUG | {"start_y_m": 3.0}, mesh={"farthest_m": 5.0})
    assert reasons() == ""


def test_walls_and_arcs_are_explained():
    said = sites.advise_on_excavation(complete({"excavation": DUG | {"cell_m": 0.0025}}))
    angle = math.degrees(math.atan(0.12 / 0.0025))
    assert any(f"{angle:.1f} degrees" in each for each in said)
    said = sites.advise_on_excavation(complete({"excavation": DUG | {"path": "ARC", "radius_m": 0.05}}))
    assert any("radius" in each for each in said)
    assert any(
        "crude" in each for each in sites.advise_on_excavation(complete({"excavation": DUG | {"width_m": 0.02}}))
    )
    assert any("under the camera" in each for each in said)
    assert not sites.advise_on_excavation(complete({}))


def test_a_path_that_crosses_itself_takes_each_place_once(tmp_path):
    file = tmp_path / "path.csv"
    # A cross of two pulls of 0.2 x 0.08 m, each drawn twice, with places that coincide.
    file.write_text(
        "state,x_m,y_m,depth_m\n" + "1,-0.1,0,0.04\n" * 2 + "1,0.1,0,0.04\n1,-0.1,0,0.04\n1,0,0,0.04\n"
        "1,0,-0.1,0.04\n1,0,0.1,0.04\n1,0,-0.1,0.04\n",
        encoding="utf-8",
    )
    facts = series(path="RECORDED", file=str(file), chips_m=0.0, states=2).facts(1)
    # Edges lie between cells of 5 mm, so the volume is exact.
    assert facts["taken_m3"] == pytest.approx(0.04 * (2 * 0.2 * 0.08 - 0.08**2), rel=1e-9)


def test_a_ring_has_the_volume_of_a_ring(tmp_path):
    turn = np.radians(np.arange(0, 361, 5))
    file = tmp_path / "path.csv"
    file.write_text(
        "state,x_m,y_m,depth_m\n" + "".join(f"1,{0.15 * math.sin(a)},{0.15 * math.cos(a)},0.04\n" for a in turn),
        encoding="utf-8",
    )
    facts = series(path="RECORDED", file=str(file), chips_m=0.0, states=2).facts(1)
    # A polygon of 72 sides in place of a circle: 0.1 %; and cells of 5 mm with 16 places each. Without the sectors that
    # the turning blade sweeps, 7 % are missing, however many sides there are.
    assert facts["taken_m3"] == pytest.approx(0.04 * math.pi * (0.19**2 - 0.11**2), rel=0.004)


def test_a_path_that_is_edited_is_read_again(tmp_path):
    file = tmp_path / "path.csv"
    for depth in (0.04, 0.06):
        file.write_text(f"state,x_m,y_m,depth_m\n1,-0.1,0,{depth}\n1,0.1,0,{depth}\n", encoding="utf-8")
        facts = series(path="RECORDED", file=str(file), chips_m=0.0, states=2).facts(1)
        assert facts["deepest_m"] == pytest.approx(depth, abs=1e-9)


def test_a_path_over_the_ground_digs_nothing_and_its_fix_is_in_the_file(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text("state,x_m,y_m,depth_m\n1,0,0,-0.03\n1,0.2,0,-0.03\n", encoding="utf-8")
    settings = complete({"excavation": DUG | {"path": "RECORDED", "file": str(file)}})
    assert any("give depth_m above 0" in each for each in sites.advise_on_excavation(settings))
    assert series(path="RECORDED", file=str(file)).facts(1)["mass_taken_kg"] == 0.0


def test_a_blade_that_passes_between_the_vertices_is_refused():
    assert "width_m of 0.004 m is less than a cell" in reasons(excavation=DUG | {"width_m": 0.004})
    assert "digs nothing; raise excavation.length_m" in reasons(excavation=DUG | {"length_m": 0.0})
    assert reasons(excavation=DUG | {"length_m": 0.0, "bite_m": 0.0}) == ""  # a series without change


def test_nothing_chips_off_where_nothing_is_dug():
    made = series(bite_m=0.0, chips_m=0.02)
    np.testing.assert_array_equal(made.at(3).layers.top, made.before_m)


def test_a_heap_that_slides_to_the_rim_is_told():
    said = series(1.2).facts(1)["advice"]
    assert any("rim of the patch" in each for each in said)
    assert series(0.1).facts(1)["advice"] == []


@pytest.mark.long
def test_many_states_deep_walls_and_wide_blades_keep_their_mass():
    for changes in (
        {"states": 40, "bite_m": 0.005},
        {"bite_m": 1.0, "cohesion_pa": 1e8, "cell_m": 0.01},
        {"width_m": 2.0, "cell_m": 0.02},
    ):
        made = series(0.05, **changes)
        last = len(made.site.pulls)
        assert made.mass_error(last) < 1e-12
        assert made.facts(last)["deepest_m"] == pytest.approx(last * made.excavation.bite_m, rel=0.02)


def test_clods_keep_the_mass_and_lie_on_spoil_only():
    smooth, rough = series(), series(clods_m=0.01)
    assert rough.mass_error(3) < 1e-12
    a, b = smooth.at(3), rough.at(3)
    np.testing.assert_array_equal(a.layers.ground, b.layers.ground)
    bare = rough.bare[3].spoil  # an uneven heap, without its clods
    off = b.layers.spoil - bare
    assert (off[bare == 0.0] == 0.0).all()
    thick = bare > 0.03
    assert 0.002 < off[thick].std() < 0.01  # as high as they are said to be
    assert b.layers.spoil.min() >= 0.0
    assert rough.facts(3)["taken_by_state_m3"] == smooth.facts(3)["taken_by_state_m3"]


def test_clods_of_many_sizes_keep_mass_and_volume_exactly():
    one, many = series(), series(0.1, clods_m=0.03, clod_sizes="MANY", cohesion_pa=0.0)
    assert many.mass_error(3) < 1e-12
    facts, bare = many.facts(3), many.bare[3].spoil
    assert facts["spoil_m3"] == pytest.approx(float(bare.sum()) * 0.005**2, rel=1e-12)
    np.testing.assert_array_equal(many.at(3).layers.ground, many.bare[3].ground)
    assert many.at(3).layers.spoil.min() >= 0.0
    assert facts["advice"] == []  # at the rim of the patch nothing changes
    level = series(clods_m=0.03, clod_sizes="MANY")
    np.testing.assert_allclose(level.facts(3)["taken_by_state_m3"], one.facts(3)["taken_by_state_m3"], rtol=1e-12)
    np.testing.assert_array_equal(series(clods_m=0.03, clod_sizes="MANY").at(2).layers.top, level.at(2).layers.top)


def test_a_sorted_heap_has_the_mass_and_the_volume_of_an_unsorted_one():
    unsorted, made = (series(clods_m=0.03, clod_sizes="MANY", sorting=sorting) for sorting in (0.0, 1.0))
    assert made.mass_error(3) < 1e-12
    assert made.facts(3)["spoil_m3"] == pytest.approx(unsorted.facts(3)["spoil_m3"], rel=1e-12)
    np.testing.assert_array_equal(made.bare[3].top, unsorted.bare[3].top)  # the next bite digs the same ground
    assert (made.at(3).layers.spoil != unsorted.at(3).layers.spoil).any()


def test_clods_lie_beyond_the_foot_of_the_heap_and_the_blade_digs_without_them():
    made = series(clods_m=0.03, clod_sizes="MANY")
    spoil, bare = made.at(3).layers.spoil, made.bare[3].spoil
    beyond = (spoil > 0.003) & (bare == 0.0)
    assert beyond.sum() * 0.005**2 > 3 * 0.02**2  # some clods of centimetres
    # Not in the trench, whose rim is a gap away; nor farther than the least friction lets them come.
    run_out = float(bare.max()) / (0.35 * math.tan(math.radians(38.0))) + 0.03
    rows, columns = np.nonzero(bare > 0.0)
    for row, column in zip(*np.nonzero(beyond), strict=True):
        assert np.hypot(rows - row, columns - column).min() * 0.005 < run_out
    again = series(clods_m=0.03, clod_sizes="MANY")
    again.at(2)
    np.testing.assert_array_equal(again.bare[2].top, made.bare[2].top)
    assert (made.bare[2].spoil != made.at(2).layers.spoil).any()
