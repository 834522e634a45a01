"""The focal length in pixels, against published fields of view."""

import math

import pytest
from icymoon.physics.rig.focal_length import focal_px
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset


@pytest.mark.parametrize(
    ("name", "horizontal_deg"),
    [("guiss", 86.3), ("mer_navcam", 45.4), ("mer_pancam", 16.3), ("mars2020_navcam", 96.0), ("europa_lander", 21.0)],
)
def test_rigs_have_their_published_fields_of_view(name, horizontal_deg):
    rig = merged(defaults(), load_preset(f"rigs/{name}")).rig
    assert 2 * math.degrees(math.atan(rig.width_px / 2 / focal_px(rig))) == pytest.approx(horizontal_deg, abs=0.1)
