"""Registering: complete, described, one with the table of settings, and gone without a trace."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import bpy
import pytest
from icymoon.operators import preferences
from icymoon.settings.table import TOPICS, list_all_settings
from icymoon.settings.topics.declaration import Setting


def run(program: str) -> str:
    """Output of a Python program of its own; it must end well."""
    ended = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=240, check=False
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_python_ends_well_with_the_extension_still_registered():
    run("""
        import icymoon
        icymoon.register()
        import bpy
        bpy.context.scene.icymoon.terrain.hurst = 0.7
        """)


def test_registering_twice_leaves_no_trace():
    run("""
        import os, sys
        import bpy, icymoon, icymoon.settings.table

        def traces():
            handlers = {name: len(found) for name in dir(bpy.app.handlers)
                        if isinstance(found := getattr(bpy.app.handlers, name), list)}
            menu = [len(getattr(getattr(bpy.types, name).draw, "_draw_funcs", ()))
                    for name in ("TOPBAR_MT_render", "VIEW3D_MT_mesh_add", "STATUSBAR_HT_header")]
            groups = {name for name in ("description", *icymoon.settings.table.TOPICS)
                      if bpy.types.PropertyGroup.bl_rna_get_subclass_py(f"ICYMOON_PG_{name}")}
            return (set(dir(bpy.types)) | groups, set(dir(bpy.ops.icymoon)), handlers, menu,
                    set(bpy.types.Scene.bl_rna.properties.keys()),
                    set(bpy.types.WindowManager.bl_rna.properties.keys()))

        for name in ("TOPBAR_MT_render", "VIEW3D_MT_mesh_add", "STATUSBAR_HT_header"):
            getattr(bpy.types, name).append(lambda self, context: None)  # so that there is a list of functions
            getattr(bpy.types, name).draw._draw_funcs.pop()
        before = traces()
        for _ in range(2):
            icymoon.register()
            assert traces()[4] > before[4], "registering adds nothing"
            icymoon.unregister()
            after = traces()
            assert after == before, [a ^ b for a, b in zip(after, before) if isinstance(a, set)] + [after[2:4]]
        sys.stdout.flush()
        os._exit(0)
        """)


def groups() -> list:
    """The RNA of the property groups below Scene.icymoon, of lists' entries too."""
    found, seen = [bpy.types.Scene.bl_rna.properties["icymoon"].fixed_type], []
    while found:
        seen.append(found.pop())
        found += [
            p.fixed_type
            for p in seen[-1].properties
            if p.type in ("POINTER", "COLLECTION") and p.fixed_type.identifier.startswith("ICYMOON_PG_")
        ]
    return seen


def ours(kind: str) -> list:
    """(RNA, name, description) of everything of a kind that Icy Moon registers."""
    if kind == "Operator":
        found = [getattr(bpy.ops.icymoon, name).get_rna_type() for name in dir(bpy.ops.icymoon)]
        return [(rna, rna.name, rna.description) for rna in found]
    if kind == "PropertyGroup":
        classes = [bpy.types.PropertyGroup.bl_rna_get_subclass_py(rna.identifier) for rna in groups()]
    elif kind == "AddonPreferences":
        classes = [preferences.ICYMOON_AP_preferences]
    else:
        classes = [
            getattr(bpy.types, name)
            for name in dir(bpy.types)
            if name.startswith("ICYMOON_") and issubclass(getattr(bpy.types, name), getattr(bpy.types, kind))
        ]
    return [(one.bl_rna, getattr(one, "bl_label", one.__name__), one.__doc__ or "") for one in classes]


@pytest.mark.parametrize("kind", ["Operator", "Panel", "Menu", "PropertyGroup", "AddonPreferences"])
def test_everything_a_person_meets_has_a_name_and_a_description(registered, kind):
    found = ours(kind)
    assert found
    built_in = {p.identifier for p in getattr(bpy.types, kind).bl_rna.properties}
    for rna, name, description in found:
        where = rna.identifier
        assert description.strip(), where
        assert not description.endswith("."), f"{where}: Blender adds the full stop itself"
        assert name.strip(), where
        for prop in rna.properties:
            if prop.identifier not in built_in and not prop.is_hidden:
                assert prop.name.strip(), f"{where}.{prop.identifier}"
                assert prop.description.strip(), f"{where}.{prop.identifier}"


def topic_group(topic: str):
    return bpy.types.Scene.bl_rna.properties["icymoon"].fixed_type.properties[topic].fixed_type.properties


@pytest.mark.parametrize(("topic", "setting"), list_all_settings(), ids=lambda v: v if isinstance(v, str) else v.key)
def test_blender_has_each_setting_as_the_table_says(registered, topic: str, setting: Setting):
    prop = topic_group(topic)[setting.key]
    assert prop.name == setting.label
    assert prop.description == setting.description
    if setting.kind == "list":
        assert prop.type == "COLLECTION"
        assert {s.key for s in setting.entries} <= set(prop.fixed_type.properties.keys())
        return
    if setting.kind == "choice":
        assert [(i.identifier, i.name, i.description) for i in prop.enum_items] == list(setting.choices)
    if setting.kind in ("int", "float"):
        assert isinstance(setting.default, (int, float))
        low, high = setting.soft or (setting.minimum, setting.maximum)
        assert prop.hard_min == pytest.approx(setting.minimum, rel=1e-6)
        assert prop.hard_max == pytest.approx(setting.maximum, rel=1e-6)
        assert prop.soft_min == pytest.approx(low, rel=1e-6)
        assert prop.soft_max == pytest.approx(high, rel=1e-6)
        assert setting.minimum <= low <= setting.default <= high <= setting.maximum
    assert prop.default == (pytest.approx(setting.default, rel=1e-6) if setting.kind == "float" else setting.default)


def test_the_groups_have_no_setting_that_the_table_lacks(registered):
    for topic in TOPICS.values():
        selected = {f"{s.key}_active" for s in topic.settings if s.kind == "list"}  # which entry the sidebar shows
        assert set(topic_group(topic.key).keys()) - {"rna_type", "name"} == {s.key for s in topic.settings} | selected
    root = bpy.types.Scene.bl_rna.properties["icymoon"].fixed_type.properties
    assert set(root.keys()) - {"rna_type", "name"} == {
        *TOPICS,
        "preset",
        "live",
        "follow",
        "results",
        "pairs",
        "error_range_m",
        "lidar",
        "variations",
    }
