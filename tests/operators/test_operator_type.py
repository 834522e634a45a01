"""Buttons that are grey for a reason."""

from __future__ import annotations

from typing import Any

import bpy
import pytest
from icymoon.operators.operator_type import ExplainedOperator


@pytest.mark.parametrize("obstacle", ["", "There is no ground"])
def test_a_button_is_grey_exactly_while_there_is_an_obstacle_and_names_it(obstacle):
    said: list[str] = []

    class Button(ExplainedOperator):
        @classmethod
        def find_obstacle(cls, context: bpy.types.Context) -> str:
            return obstacle

        poll_message_set: Any = said.append

    assert Button.poll(bpy.context) is not bool(obstacle)
    assert said == [obstacle] * bool(obstacle)


def test_an_operator_without_an_obstacle_can_run():
    assert ExplainedOperator.poll(bpy.context)
