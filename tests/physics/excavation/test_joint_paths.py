"""A trench from recorded joints: where the arm's tip goes, and which lines are refused."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.arm.parametric_arm import choose_inverse_solution, make_parametric_arm
from icymoon.physics.excavation import dig_site as sites
from icymoon.physics.excavation.dig import ExcavationSeries
from icymoon.physics.excavation.joint_paths import make_joint_pulls
from icymoon.settings import description, rebuilt_parts
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError
from urdf_files import write_robot

HEAD = "state,yaw_deg,shoulder_deg,elbow_deg,wrist_deg,roll_deg\n"
#: Level ground, on which depths below the arm's level are depths below the ground.
LEVEL = {"terrain": {"rms_slope_deg": 0.0}, "rocks": {"coverage": 0.0}}


def described(file, **topics) -> Settings:
    part = {
        **LEVEL,
        "excavation": {
            "path": "JOINTS",
            "file": str(file),
            "states": 2,
            "state": 1,
            "width_m": 0.08,
            "chips_m": 0.0,
            "cell_m": 0.005,
        },
        **topics,
    }
    return description.merged(description.defaults(), description.check(part, "test"))


def write_lines(file, settings, places) -> None:
    """A file with the joints that put the tip on each place (state, east, north, height)."""
    arm = make_parametric_arm(settings)
    lines = [
        ",".join(repr(float(each)) for each in (state, *np.degrees(choose_inverse_solution(arm, x, y, z))))
        for state, x, y, z in places
    ]
    file.write_text(HEAD + "\n".join(lines), encoding="utf-8")


def test_the_blade_goes_where_the_tip_goes_and_digs_as_a_line_does(tmp_path):
    file = tmp_path / "joints.csv"
    settings = described(file)
    north = np.linspace(1.8, 1.5, 31)
    above = [(1, 0.125, 1.8, 0.3), (1, 0.125, 1.8, 0.03)]  # it comes from above, where it digs nothing
    write_lines(file, settings, [*above, *((1, 0.125, y, -0.05) for y in north)])
    (pulls,), deepest = make_joint_pulls(settings)
    assert deepest == pytest.approx(0.05, abs=1e-6)
    ends = np.array([pull.point(float(along), 0.0) for pull in pulls for along in pull.along_m])
    assert np.abs(ends[:, 0] - 0.125).max() < 1e-3  # joints turn evenly between lines, not the tip straight
    assert ends[:, 1].min() == pytest.approx(1.5, abs=1e-6)
    site = sites.make_site(settings)
    made = ExcavationSeries(site, settings.excavation, 1, np.zeros((site.grid.rows, site.grid.columns)), 0.0)
    # A prism of 0.3 x 0.08 x 0.05 m; the tip sags by less than a tenth of a millimetre between lines of 1 cm.
    assert made.facts(1)["taken_m3"] == pytest.approx(0.3 * 0.08 * 0.05, rel=0.01)
    assert made.mass_error(1) < 1e-12
    assert not sites.find_refusals(settings)


def test_depths_count_from_the_arms_level_and_not_from_the_plane_of_the_ground(tmp_path):
    file = tmp_path / "joints.csv"
    settings = described(file)
    write_lines(file, settings, [(1, 0.125, y, -0.05) for y in np.linspace(1.8, 1.5, 31)])
    site = sites.make_site(settings)
    shape = (site.grid.rows, site.grid.columns)
    taken = [
        ExcavationSeries(site, settings.excavation, 1, np.full(shape, rise), 0.0).at(1).taken_m3
        for rise in (0.0, 0.02, -0.05)
    ]
    assert taken[1] / taken[0] == pytest.approx(0.07 / 0.05, rel=0.01)
    assert taken[2] == pytest.approx(0.0, abs=1e-5)


def test_a_line_beyond_a_limit_is_named_by_its_number(tmp_path):
    file = tmp_path / "joints.csv"
    file.write_text(HEAD + "1,0,20,-70,-40,0\n1,0,20,-70,-40,0\n1,0,20,-170,-40,0\n", encoding="utf-8")
    (reason,) = sites.find_refusals(described(file))
    assert "line 4" in reason
    assert "elbow at -170°, but its limits are -165° to 165°" in reason


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("state,yaw_deg\n1,0\n", "no column shoulder_deg"),
        (HEAD, "no line of numbers"),
        (HEAD + "1,0,20,-70,x,0\n", "line 2 is not a pose"),
        (HEAD + "0,0,20,-70,-40,0\n", "line 2 is not a pose"),
        (HEAD + "1,0,20,-70,nan,0\n", "line 2 is not a pose"),
        (HEAD + "7,0,20,-70,-40,0\n", "raise excavation.states"),
        (HEAD + "1,0,20,-70,-40,0\n", "in which the scoop's tip moves"),
        (HEAD + "1,0,20,-70,-40,0\n" * 20_001, "more than 20000 lines"),
        # 399 turns of 100 degrees there and back: each line is fine, and they are 39 900 steps of a degree.
        (HEAD + "1,-50,20,-70,-40,0\n1,50,20,-70,-40,0\n" * 200, "has 39901 places, a degree apart, more than 20000"),
    ],
)
def test_a_bad_file_is_a_sentence(tmp_path, text, words):
    file = tmp_path / "joints.csv"
    file.write_text(text, encoding="utf-8")
    (reason,) = sites.find_refusals(described(file))
    assert words in reason


def test_an_arm_that_stays_above_the_ground_digs_nothing_and_there_is_advice(tmp_path):
    file = tmp_path / "joints.csv"
    settings = described(file)
    write_lines(file, settings, [(1, 0.1, y, 0.2) for y in (1.6, 1.5)])
    assert any("Nothing is dug" in text for text in sites.advise_on_excavation(settings))


def test_an_arm_of_the_users_own_has_columns_of_its_own(tmp_path):
    path = write_robot(tmp_path)
    file = tmp_path / "joints.csv"
    file.write_text("state,yaw_deg,pitch_deg,reach_m\n1,0,0,0\n1,10,5,0.1\n1,20,5,0.6\n", encoding="utf-8")
    settings = described(file, lander={"kind": "OWN", "file": str(path)})
    with pytest.raises(IcyMoonError, match=r"line 4 puts the joint reach at 0\.6 m"):
        make_joint_pulls(settings)
    file.write_text("state,yaw_deg,pitch_deg,reach_m\n1,0,0,0\n1,10,5,0.1\n", encoding="utf-8")
    (pulls,), _ = make_joint_pulls(settings)
    assert len(pulls) == 10  # steps of a degree of the joint that turns most


def test_the_ground_depends_on_the_arms_sizes_but_not_on_where_it_is_now(tmp_path):
    settings = described(tmp_path / "joints.csv")
    turned = description.merged(settings, {"arm": {"yaw_deg": 5.0}})
    longer = description.merged(settings, {"arm": {"upper_m": 1.1}})
    assert (
        rebuilt_parts.select_scene(turned) == rebuilt_parts.select_scene(settings) != rebuilt_parts.select_scene(longer)
    )


def test_a_path_is_read_again_only_if_something_it_depends_on_has_changed(tmp_path, monkeypatch):
    file = tmp_path / "joints.csv"
    settings = described(file)
    read = []
    monkeypatch.setattr(sites, "make_joint_pulls", lambda given: read.append(1) or make_joint_pulls(given))
    counts = []
    for north, topics in (
        (1.5, {}),
        (1.5, {"excavation": {"state": 0}}),
        (1.5, {"arm": {"upper_m": 1.01}}),
        (1.5, {"rig": {"x_m": 0.1}}),
        (1.4, {}),
    ):
        if not counts or north != 1.5:
            write_lines(file, settings, [(1, 0.125, y, -0.05) for y in np.arange(1.8, north, -0.05)])
        changed = description.merged(settings, topics)
        made = [sites.make_site(changed) for _ in range(3)]
        assert made[0] is made[1] is made[2]
        counts.append(len(read))
    assert counts == [1, 1, 2, 3, 4]
    own = described(file, lander={"kind": "OWN", "file": str(write_robot(tmp_path))})
    file.write_text("state,yaw_deg,pitch_deg,reach_m\n1,0,0,0\n1,10,5,0.1\n", encoding="utf-8")
    before = sites.make_site(own).trench_m
    (tmp_path / "arm.urdf").write_text(
        (tmp_path / "arm.urdf").read_text(encoding="utf-8").replace('xyz="0.4 0 0.1"', 'xyz="0.55 0 0.1"'),
        encoding="utf-8",
    )
    assert sites.make_site(own).trench_m != before
