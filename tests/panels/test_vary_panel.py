"""The panel Vary This Scene and the entry in the context menu of settings."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import pytest
from icymoon.operators import show_pair
from icymoon.panels import sidebar, vary
from icymoon.settings.blender import scene_properties
from icymoon.settings.table import TOPICS
from panel_drawing import Layout, drawn, texts
from stand_ins import stand_in


def operators(record: list) -> set[str]:
    return {entry[1] for entry in record if entry[0] == "operator"}


def test_the_data_set_begins_with_the_present_scene():
    assert vary.ICYMOON_PT_vary.bl_order < sidebar.ICYMOON_PT_plan.bl_order
    assert vary.ICYMOON_PT_vary.bl_parent_id == sidebar.ICYMOON_PT_plan.bl_parent_id == "ICYMOON_PT_dataset"
    assert "DEFAULT_CLOSED" in sidebar.ICYMOON_PT_plan.bl_options


def test_an_empty_list_tells_how_to_begin(scene):
    record = drawn(vary.ICYMOON_PT_vary)
    assert "Right-click a setting" in texts(record)
    assert {"icymoon.vary", "icymoon.render_variations", "icymoon.save_plan"} <= operators(record)


def test_the_selected_setting_is_drawn_with_its_unit(scene):
    bpy.ops.icymoon.vary(setting="light.sun_elevation_deg", first=5, last=60, count=5)
    record = drawn(vary.ICYMOON_PT_vary)
    assert "Sun Elevation: 5 to 60°, 5" in texts(record)
    assert "From (°)" in texts(record)
    assert "5, 18.75, 32.5, 46.25, 60" in texts(record)
    assert "5 values of Sun Elevation = 5" in texts(record)
    assert "no effect" not in texts(record)


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("quality.samples", "Samples: 16 to 64 samples, 5"),
        ("light.planet", "Planet: off, on"),
        ("mesh.crests", "Crests: Rounded, "),
        ("textures.mapping", "Mapping: 4 values"),
        ("surface.model", "Model: 6 values"),
        ("rig.baseline_m", "Baseline: 0.125 to 0.5 m, 5"),
    ],
)
def test_a_line_of_the_list_has_the_values(scene, name, line):
    bpy.ops.icymoon.vary(setting=name)
    assert line in texts(drawn(vary.ICYMOON_PT_vary))


@pytest.mark.parametrize(
    ("name", "first"),
    [("light.sun_elevation_deg", 10.25), ("rig.baseline_m", 0.25), ("light.sun_temperature_k", 1000.25)],
)
def test_ends_are_drawn_with_the_decimals_of_the_setting(scene, name, first):
    topic, key = name.split(".")
    bpy.ops.icymoon.vary(setting=name, first=first, last=2 * first)
    item = scene.icymoon.variations.varied[0]
    drawn_as = scene_properties.shown_property_name("first", TOPICS[topic][key].precision)
    record = drawn(vary.ICYMOON_PT_vary)
    assert any(drawn_as in str(entry) for entry in record)
    prop = item.bl_rna.properties[drawn_as]
    assert prop.precision == getattr(scene.icymoon, topic).bl_rna.properties[key].precision
    assert getattr(item, drawn_as) == first
    setattr(item, drawn_as, 1.5 * first)
    assert scene_properties.read_item(item).first == 1.5 * first


def test_a_setting_without_an_effect_is_told(scene):
    bpy.ops.icymoon.vary(setting="hapke.w")
    bpy.ops.icymoon.vary(setting="light.planet_albedo")
    assert "It has no effect" in texts(drawn(vary.ICYMOON_PT_vary))
    scene.icymoon.light.planet = True
    assert "It has no effect" not in texts(drawn(vary.ICYMOON_PT_vary))


def test_a_list_of_another_version_is_drawn(scene):
    scene.icymoon.variations.varied.add().setting = "light.gone"
    shown = " ".join(entry[2].get("text", "") for entry in drawn(vary.ICYMOON_PT_vary) if entry[0] == "label")
    assert "This setting cannot vary" in shown
    assert "unknown setting" in shown


def test_the_first_and_the_last_pair_are_shown_once_several_are_rendered(scene, tmp_path):
    ids = ["0123456789ab", "123456789abc"]
    for name in ids:
        (tmp_path / "pairs" / name).mkdir(parents=True)
        (tmp_path / "pairs" / name / "pair.json").write_text("{}")
    scene.icymoon.variations.folder = str(tmp_path)
    scene.icymoon.variations.pairs = ids[0]
    assert "Last Pair" not in texts(drawn(vary.ICYMOON_PT_vary))
    scene.icymoon.variations.pairs = " ".join(ids)
    assert "Last Pair" in texts(drawn(vary.ICYMOON_PT_vary))
    assert "Evaluate These Variations" in texts(drawn(vary.ICYMOON_PT_vary))
    scene.icymoon.variations.folder = ""
    assert "These Variations" not in texts(drawn(vary.ICYMOON_PT_vary)).replace("Render These Variations", "")


def test_arrows_step_from_the_scenes_pair_to_its_variations(scene, tmp_path):
    ids = ["0123456789ab", "123456789abc", "23456789abcd"]
    for folder, name in zip(("own", "varied", "varied"), ids, strict=True):
        (tmp_path / folder / "pairs" / name).mkdir(parents=True)
        (tmp_path / folder / "pairs" / name / "pair.json").write_text("{}")
    scene.icymoon.dataset.folder, scene.icymoon.pairs = str(tmp_path / "own"), ids[0]
    scene.icymoon.variations.folder, scene.icymoon.variations.pairs = str(tmp_path / "varied"), " ".join(ids[1:])
    assert [path.name for path in show_pair.find_pairs_to_show(scene)] == ids
    assert [path.name for path in show_pair.find_kept_pairs(scene)] == ids[:1]
    for text in ("../../etc", "varied"):
        scene.icymoon.variations.pairs = text
        assert [path.name for path in show_pair.find_pairs_to_show(scene)] == ids[:1]


def test_draws_are_asked_for_where_they_are_made(scene):
    for name in ("light.sun_elevation_deg", "surface.albedo"):
        bpy.ops.icymoon.vary(setting=name)
    assert "icymoon.variations.draws" not in texts(drawn(vary.ICYMOON_PT_vary))
    scene.icymoon.variations.combine = "SOBOL"
    assert "icymoon.variations.draws" in texts(drawn(vary.ICYMOON_PT_vary))
    assert "16 draws of 2 settings" in texts(drawn(vary.ICYMOON_PT_vary))


def test_the_context_menu_offers_settings_only(scene):
    def menu(group, key):
        shown = stand_in(layout=Layout())
        vary._draw_context_menu(shown, SimpleNamespace(button_prop=group.bl_rna.properties[key], button_pointer=group))
        return operators(shown.layout.record)

    assert menu(scene.icymoon.light, "sun_elevation_deg") == {"icymoon.vary"}
    assert menu(scene.icymoon.sensor, "bits") == {"icymoon.vary"}  # grey, with the reason
    assert menu(scene.render, "resolution_x") == menu(scene.icymoon, "live") == set()


def test_the_dialog_draws_what_the_setting_has(scene):
    dialog = stand_in(layout=Layout(), setting="light.planet")
    vary.varied_settings.ICYMOON_OT_vary.draw(dialog, bpy.context)
    assert "Off and on" in texts(dialog.layout.record)
