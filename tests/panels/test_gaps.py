"""No panel has a gap: a row or column with nothing in it, or an empty line with a text below it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import bpy
from evaluations import ROW, evaluated
from icymoon.operators.session import session
from icymoon.panels import CLASSES, sidebar
from panel_drawing import Layout
from stand_ins import stand_in

CONTAINERS = {"row", "column", "box", "split", "column_flow", "grid_flow"}


class Nested(Layout):
    """Records each part within the part that contains it, as (kind, text, parts)."""

    inside: list[Any]

    def __init__(self, record: list[Any] | None = None, inside: list[Any] | None = None) -> None:
        super().__init__(record)
        self.__dict__["inside"] = [] if inside is None else inside

    def __getattr__(self, name: str) -> Callable[..., Nested]:
        call = super().__getattr__(name)

        def noted(*arguments: object, **options: object) -> Nested:
            call(*arguments, **options)
            return self.add(name, str(options.get("text", "")))

        return noted

    def add(self, kind: str, text: str = "") -> Nested:
        parts: list[Any] = []
        self.inside.append((kind, text, parts))
        return Nested(self.record, parts)

    def panel(self, name: str, *, default_closed: bool = False) -> tuple[Layout, Layout]:
        return self.add("header"), self.add("body")

    def prop(self, data: Any, key: str, **options: object) -> None:
        super().prop(data, key, **options)
        self.add("prop")

    def operator(self, name: str, **options: Any) -> object:
        self.add("operator")
        return super().operator(name, **options)

    def menu(self, name: str, **options: object) -> None:
        super().menu(name, **options)
        self.add("menu")

    def template_list(self, *arguments: Any, **options: object) -> None:
        self.add("list")


def list_gaps(parts: list[Any]) -> Iterator[str]:
    for k, (kind, text, inside) in enumerate(parts):
        if kind in CONTAINERS and not inside:
            yield f"an empty {kind}"
        if kind == "separator" and k == len(parts) - 1:
            yield "a separator at the end"
        if (kind, text) == ("label", "") and any(below for _, below, _ in parts[k + 1 :]):
            yield "an empty line above a text"
        yield from list_gaps(inside)


def gaps_of_panels() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    every: list[Any] = [*CLASSES]
    for cls in every:
        if issubclass(cls, bpy.types.Panel) and getattr(cls, "poll", lambda context: True)(bpy.context):
            layout = Nested()
            kept = {name: getattr(cls, name) for name in ("topic", "section") if hasattr(cls, name)}
            cls.draw(stand_in(layout=layout, **kept), bpy.context)
            found[cls.bl_idname] = list(list_gaps(layout.inside))
    # Above the two columns of qualities, the title of the second is beside an empty one.
    found["ICYMOON_PT_quality"] = [gap for gap in found["ICYMOON_PT_quality"] if gap != "an empty line above a text"]
    return {panel: gaps for panel, gaps in found.items() if gaps}


def test_a_gap_is_found():
    layout = Nested()
    layout.row()
    column = layout.column()
    column.label(text="")
    column.label(text="Text")
    column.separator()
    assert list(list_gaps(layout.inside)) == ["an empty row", "an empty line above a text", "a separator at the end"]


def test_no_panel_has_a_gap_before_a_build_and_after_each_step(small, tmp_path):
    try:
        assert gaps_of_panels() == {}
        bpy.ops.icymoon.build_scene()
        assert gaps_of_panels() == {}
        bpy.ops.icymoon.render_pair()
        assert gaps_of_panels() == {}
        bpy.ops.icymoon.show_pair()
        evaluated(small, tmp_path / "dataset", ROW, {**ROW, "method": "sgbm"})
        assert gaps_of_panels() == {}
    finally:
        session.reset()


def count_status_lines() -> int:
    layout = Nested()
    sidebar.ICYMOON_PT_main.draw(stand_in(layout=layout), bpy.context)
    kind, _, parts = layout.inside[-1]
    assert kind == "column"
    return sum(1 if each[0] == "label" else len(each[2]) for each in parts)


def test_the_lines_about_the_scene_take_the_same_room_however_long_they_are(small, monkeypatch):
    """Otherwise the panels below would move under the mouse."""
    bpy.ops.icymoon.build_scene()
    before = count_status_lines()
    monkeypatch.setattr(sidebar.live_preview, "list_lines", lambda scene: [sidebar._STATUS_ROOM])
    monkeypatch.setattr(sidebar, "describe_view", lambda *_: sidebar.LONGEST)
    assert count_status_lines() == before
    monkeypatch.setattr(sidebar, "describe_view", lambda *_: "Solid view")
    assert count_status_lines() == before
