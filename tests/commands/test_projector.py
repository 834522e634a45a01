"""The verb ``projector`` without a render: the lamp of the projector, its field, and sentences about it."""

from __future__ import annotations

import argparse
import math

import pytest
from icymoon.commands.cli import main
from icymoon.commands.projector import add_options, add_projector, make_projector, name_projector
from icymoon.physics.light.lamps import radiant_power_w
from icymoon.physics.scene_checks import describe_buried_lamp
from icymoon.settings.description import check, defaults, merged


def test_the_projector_is_the_last_lamp_and_shines_with_its_power():
    parser = argparse.ArgumentParser()
    add_options(parser)
    settings = merged(defaults(), check({"light": {"lamps": [{}], "lamp_scales": "0.5"}}, "test"))
    options = parser.parse_args(["--out", "x", "--power", "3", "--place", "0.1", "0.2", "0.3"])
    projector = make_projector(options, settings)
    lit = add_projector(settings, projector)
    assert lit.light.lamp_scales == "0.5, 1"
    _, lamp = lit.light.lamps
    assert (lamp.x_m, lamp.y_m, lamp.z_m) == (0.1, 0.2, 0.3)
    assert radiant_power_w(lamp) * projector.share_of_cone == pytest.approx(3.0)
    rig = settings.rig
    wide = 2 * math.degrees(math.atan(rig.sensor_width_mm / 2 / rig.focal_length_mm))
    assert projector.width_deg == pytest.approx(wide)


def test_a_projector_in_the_ground_is_told_by_its_option():
    told = name_projector(describe_buried_lamp(1, 0.5), 1)
    assert told == "The projector is 0.5 m under the ground, so it lights nothing; move it by --place."
    assert name_projector(describe_buried_lamp(0, 0.5), 1) == describe_buried_lamp(0, 0.5)


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["--pattern", "gray_phase", "--transport-mm", "-1"], "--transport-mm is -1; give more than 0"),
        (["--pattern", "gray_phase", "--transport-mm", "nan"], "--transport-mm is nan; give more than 0"),
        (["--pattern", "gray_phase", "--transport-mm", "0"], "--transport-mm is 0; give more than 0"),
        (["--transport-mm", "5"], "add --pattern gray_phase"),
        (["--period-px", "nan"], "period of nan pixels; give 4 or more"),
        (["--pattern", "stripes", "--dot-px", "inf"], "dots are inf pixels wide; give 0.5 to 1000"),
    ],
)
def test_numbers_that_have_no_use_are_refused_before_the_render(words, part, tmp_path, capsys):
    assert main(["projector", *words, "--out", str(tmp_path / "out"), "--blender", "/nowhere/blender"]) == 1
    assert part in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
