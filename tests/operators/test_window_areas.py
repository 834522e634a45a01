"""Areas of the window."""

from __future__ import annotations

import pytest
from icymoon.operators import window_areas
from icymoon.support.errors import IcyMoonError
from stand_ins import stand_in


def test_no_view_is_rendered_while_a_scene_is_built(monkeypatch):
    """Blender crashes where Cycles reads a scene in the middle of a build."""
    shadings = [stand_in(type=each) for each in ("RENDERED", "SOLID", "RENDERED", "MATERIAL")]
    areas = [(None, stand_in(spaces=stand_in(active=stand_in(shading=each)))) for each in shadings]
    monkeypatch.setattr(window_areas, "list_areas", lambda kind: areas)

    def build() -> None:
        assert [each.type for each in shadings] == ["SOLID", "SOLID", "SOLID", "MATERIAL"]
        raise IcyMoonError("There is no ground.")

    with pytest.raises(IcyMoonError), window_areas.pause_rendered_views():
        build()
    assert [each.type for each in shadings] == ["RENDERED", "SOLID", "RENDERED", "MATERIAL"]
