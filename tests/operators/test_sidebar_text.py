"""What the sidebar keeps from one redraw to the next: never anything that has changed."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import bpy
import icymoon.settings.blender.scene_properties as properties
import pytest
from icymoon.operators import sidebar_text
from icymoon.operators.sidebar_text import remember_answers
from icymoon.settings import change_announcements
from icymoon.settings.table import TOPICS
from icymoon.support.version import ROOT

#: Rooms whose sentences the window shows.
ROOMS = ("formats", "nodes", "operators", "panels", "physics", "render", "settings", "stereo")
SETTING = re.compile(r"\b([a-z_]+)[.]([a-z]\w*)")
#: Names of choices that are no words of the window; OSL, CPU and GPU are.
CHOICES = {choice[0] for topic in TOPICS.values() for setting in topic.settings for choice in setting.choices} - {
    "OSL",
    "CPU",
    "GPU",
}


def sentences(path: Path) -> Iterator[str]:
    """The texts of a module that name a setting by its key, with 42 for what is computed; no docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        values = node.values if isinstance(node, ast.JoinedStr) else [node] if isinstance(node, ast.Constant) else []
        text = "".join(str(v.value) if isinstance(v, ast.Constant) else "42" for v in values)
        if id(node) not in told and " " in text.strip() and names_setting(text):
            yield text


def names_setting(text: str) -> bool:
    return any(
        topic in TOPICS and key in {setting.key for setting in TOPICS[topic].settings}
        for topic, key in SETTING.findall(text)
    )


def test_settings_are_read_once_a_redraw_and_again_after_every_change(scene, monkeypatch):
    group, clock = scene.icymoon, [100.0]
    monkeypatch.setattr(properties.time, "monotonic", lambda: clock[0])
    first = properties.read_for_display(group)
    assert first == properties.read_unchecked(group)
    assert properties.read_for_display(group) is first
    group.terrain.size_m = 7.0
    assert properties.read_for_display(group).terrain.size_m == 7.0
    with change_announcements.batch_changes():
        group.terrain.size_m = 8.0
        assert properties.read_for_display(group).terrain.size_m == 8.0
    before = properties.read_for_display(group)
    clock[0] += 1.0
    assert properties.read_for_display(group) is before
    clock[0] += 1.0
    undone = properties.read_unchecked(group)
    undone.terrain.size_m = 7.0  # animation and undo change properties without announcing it
    monkeypatch.setattr(properties, "read_unchecked", lambda group: undone)
    assert properties.read_for_display(group).terrain.size_m == 7.0


def test_undo_is_displayed_however_soon_it_comes_after_a_redraw(scene, monkeypatch):
    undone = properties.read_unchecked(scene.icymoon)
    undone.terrain.size_m = 7.0
    monkeypatch.setattr(properties.time, "monotonic", lambda: 0.0)
    before = properties.read_for_display(scene.icymoon)
    monkeypatch.setattr(properties, "read_unchecked", lambda group: undone)
    assert properties.read_for_display(scene.icymoon) is before
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        assert properties._forget_displayed in handlers
    properties._forget_displayed()
    assert properties.read_for_display(scene.icymoon).terrain.size_m == 7.0


@pytest.mark.parametrize(
    ("region", "scale", "longest"),
    [
        (None, 1.0, 36),
        (("WINDOW", 900), 1.0, 36),
        (("UI", 280), 1.0, 36),
        (("UI", 560), 1.0, 72),
        (("UI", 560), 2.0, 36),
        (("UI", 30), 1.0, 18),
    ],
)
def test_text_is_as_wide_as_the_sidebar(monkeypatch, region, scale, longest):
    shown = region and SimpleNamespace(type=region[0], width=region[1])
    system = SimpleNamespace(ui_scale=scale)
    monkeypatch.setattr(
        sidebar_text.bpy, "context", SimpleNamespace(region=shown, preferences=SimpleNamespace(system=system))
    )
    lines = sidebar_text.wrap_lines("word " * 60, "  ")
    assert max(map(len, lines)) <= longest < max(map(len, lines)) + 5
    assert all(line.startswith("  ") for line in lines[1:])
    beside_an_icon = sidebar_text.wrap_lines("word " * 60, icon=True)
    assert max(map(len, beside_an_icon)) <= longest - 4


@pytest.mark.parametrize("width", [200, 280, 420])
@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_in_a_window_lines_are_as_wide_as_their_letters_allow(monkeypatch, width, scale):
    """Letters have their own widths: as many narrow ones fit as the room takes, and no line of wide ones is cut."""
    sizes = []
    monkeypatch.setattr(sidebar_text.blf, "size", lambda font, size: sizes.append(size))
    measure = lambda text: sizes[-1] * sum(0.25 if letter in "il. " else 0.8 for letter in text)  # noqa: E731
    monkeypatch.setattr(sidebar_text.blf, "dimensions", lambda font, text: (measure(text), 1.0))
    preferences = SimpleNamespace(
        system=SimpleNamespace(ui_scale=scale), ui_styles=[SimpleNamespace(widget=SimpleNamespace(points=11.0))]
    )
    region = SimpleNamespace(type="UI", width=round(width * scale))
    blender = SimpleNamespace(
        app=SimpleNamespace(background=False), context=SimpleNamespace(region=region, preferences=preferences)
    )
    monkeypatch.setattr(sidebar_text, "bpy", blender)
    counts = {}
    for word in ("ill", "www"):
        for icon in (False, True):
            text = " ".join([word] * 40)
            lines = sidebar_text.wrap_lines(text, icon=icon)
            assert " ".join(lines) == text
            room_px = (width - 62 - 25 * icon) * scale
            assert all(measure(line) <= room_px for line in lines)
            assert all(measure(f"{line} {word}") > room_px for line in lines[:-1])
            counts[word, icon] = len(lines)
    assert counts["ill", False] < 0.6 * counts["www", False]
    assert counts["ill", False] <= counts["ill", True]


def test_what_goes_on_in_the_next_line_is_indented_further_than_a_line_that_is_indented():
    first, second, *_ = sidebar_text.wrap_lines("  0.0104 W/m², 0.00872 on flat ground of the site")
    assert first.startswith("  0.0104")
    assert second.startswith("    ")
    assert sidebar_text.wrap_lines("word " * 30)[1].startswith("word")


@pytest.mark.parametrize("measure", ["5 %", "10 cm", "2 W/m²", "40 MB", "8 px"])
def test_no_number_is_parted_from_its_unit(measure):
    for before in range(20, sidebar_text.LINE):
        text = f"{'x' * before} {measure} of the light comes from the planet"
        lines = sidebar_text.wrap_lines(text)
        assert any(measure in line for line in lines)
        assert " ".join(lines) == text


@pytest.mark.parametrize("held", ["is 0", "is -0.5", "is off", "Light ▸"])
def test_no_line_begins_with_a_lone_number_or_an_arrow(held):
    """'Grey while Albedo Variation is' was followed by a line with nothing but 0."""
    for before in range(15, sidebar_text.LINE):
        text = f"{'x' * before} {held} Sun Elevation"
        lines = sidebar_text.wrap_lines(text)
        assert any(held in line for line in lines)
        assert " ".join(lines) == text


def test_an_answer_is_kept_for_equal_settings_only():
    asked = []

    def double(settings):
        asked.append(dict(settings))
        return 2 * settings["x"]

    kept = remember_answers(double)
    assert [kept({"x": 1}), kept({"x": 1}), kept({"x": 2}), kept({"x": 1})] == [2, 2, 4, 2]
    assert asked == [{"x": 1}, {"x": 2}]
    assert [kept({"x": k}) for k in range(10)] == [2 * k for k in range(10)]


def test_no_sentence_shows_a_key_or_the_name_of_a_choice_in_the_window():
    found = [text for room in ROOMS for path in sorted((ROOT / room).rglob("*.py")) for text in sentences(path)]
    assert len(found) > 150
    shown = [sidebar_text.replace_keys_by_labels(text) for text in found]
    assert [text for text in shown if names_setting(text)] == []
    words = {text: CHOICES & set(re.findall(r"\b[A-Z][A-Z_]{2,}\b", text)) for text in shown}
    assert {text: some for text, some in words.items() if some} == {}
