"""Whether the arm gets to a trench, against its inverse kinematics, and the fix that is offered."""

import re

import numpy as np
import pytest
from icymoon.physics.arm.parametric_arm import choose_inverse_solution, make_parametric_arm
from icymoon.physics.excavation.arm_reach import advise_on_reach, compute_share_in_reach
from icymoon.physics.excavation.dig_site import make_site
from icymoon.physics.scene_checks import advise_on_scene
from icymoon.settings import description


def complete(excavation, lander="PARAMETRIC"):
    return description.merged(
        description.defaults(),
        description.check(
            {"excavation": {"path": "LINE"} | excavation, "lander": {"kind": lander}, "light": {"body": "EUROPA"}},
            "test",
        ),
    )


def test_the_share_is_that_of_the_inverse_kinematics():
    settings = complete({"start_y_m": 3.3, "length_m": 0.8})
    (pull,) = make_site(settings).pulls[-1]
    along = np.linspace(0.0, 0.8, 9)
    solved = choose_inverse_solution(
        make_parametric_arm(settings), 0.0, 3.3 - along, np.full(9, -float(pull.depth_m[0]))
    )
    share = compute_share_in_reach(make_parametric_arm(settings), [pull])
    assert share == np.isfinite(solved).all(axis=1).mean()
    assert 0.0 < share < 1.0


def test_a_trench_in_reach_or_without_a_lander_needs_no_advice():
    assert advise_on_reach(complete({"start_y_m": 2.0})) == []
    assert advise_on_reach(complete({"start_y_m": 5.0}, lander="NONE")) == []


@pytest.mark.parametrize("place", [{"start_y_m": 5.0}, {"start_x_m": 4.0, "start_y_m": 1.0}, {"start_y_m": 3.0}])
def test_the_place_that_is_offered_is_in_reach(place):
    (said,) = advise_on_reach(complete(place))
    numbers = re.search(r"start_x_m = (-?[0-9.]+) and excavation.start_y_m = (-?[0-9.]+[0-9])", said)
    assert numbers is not None
    assert advise_on_reach(complete({"start_x_m": float(numbers[1]), "start_y_m": float(numbers[2])})) == []


def test_a_trench_deeper_than_the_arm_is_long_cannot_be_moved_into_reach():
    (said,) = advise_on_reach(complete({"bite_m": 1.0, "states": 5, "cell_m": 0.02, "cohesion_pa": 1e6}))
    assert "dig less deep" in said


def test_a_scene_states_it():
    settings = complete({"start_y_m": 5.0})
    assert advise_on_reach(settings)[0] in advise_on_scene(settings)
