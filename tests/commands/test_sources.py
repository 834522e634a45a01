"""Every number of a scene leads to the preset that states it and to its source."""

from __future__ import annotations

import pytest
from icymoon.commands.sources import BY_HAND, DEFAULT, find_origins
from icymoon.settings import description, preset_files, toml_text
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError


def described(*presets: str, **changes: dict) -> Settings:
    return description.merged(description.defaults(), *(preset_files.load_preset(name) for name in presets), changes)


def found(settings: Settings, *asked: str) -> dict:
    return {origin.name: origin for origin in find_origins(settings, asked)}


@pytest.mark.ci_takes(6)
@pytest.mark.parametrize("scene", preset_files.preset_names("scenes"))
def test_every_number_that_a_scene_preset_states_is_traced_to_it_or_to_what_it_includes(scene):
    """Followed back by hand: the files that the scene includes, and theirs."""
    files, family = [scene], {}
    while files:
        name = files.pop()
        raw = toml_text.read_toml(preset_files.find_preset(name))
        files += raw["preset"].get("include", [])
        family[name] = raw
    settings = described(scene)
    stated = {
        f"{topic}.{key}"
        for raw in family.values()
        for topic in raw
        if topic not in ("preset", "sources", "measured")
        for key in raw[topic]
    }
    traced = found(settings, *settings)
    for name in stated:
        origin = traced[name]
        assert origin.preset in family, f"{name} of {scene} is said to be from {origin.preset}"
        assert origin.source == family[origin.preset]["sources"][name]


def test_what_a_person_states_is_told_from_presets_and_defaults():
    settings = described("scenes/enceladus_fresh_snow", rig={"baseline_m": 0.123})
    traced = found(settings, "rig", "sensor.noise_seed", "light.sun_irradiance_wm2")
    assert traced["rig.baseline_m"].preset == BY_HAND
    assert traced["rig.focal_length_mm"].preset == "rigs/guiss"
    assert traced["sensor.noise_seed"].preset == DEFAULT
    assert traced["light.sun_irradiance_wm2"].preset == "bodies/enceladus"
    assert "light.planet" not in traced


def test_a_law_that_the_scene_does_not_use_has_no_source_in_its_presets():
    """The defaults of Hapke's law are those of a preset; snow is not made of it."""
    assert not any("hapke" in origin.preset for origin in find_origins(described("scenes/enceladus_fresh_snow")))
    assert found(described("surfaces/hapke_europa_global"))["hapke.w"].preset == "surfaces/hapke_europa_global"


def test_an_unknown_name_is_refused():
    with pytest.raises(IcyMoonError, match="neither a topic nor a setting"):
        list(find_origins(description.defaults(), ["albedo"]))
