"""A person at Blender's window: mouse, keys, looking for buttons, waiting, taking pictures; runs inside Blender.

What takes time is a generator that yields the seconds until it wants to go on. It waits for what it is
after, never for a time in which a fast machine would have it.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import addon_utils
import bpy

TICK_S = 0.1
#: After which anything is taken for stuck. No measure of speed.
PATIENCE_S = 150.0
#: The most that one turn of the event loop counts for: without a graphics card a busy machine takes seconds for one.
MAX_TURN_S = 1.0
ADD_ON = "bl_ext.user_default.icymoon"
F3 = "69"  # as a key code: given its name, xdotool may press Alt with it
#: What takes a while: it yields how long to wait, and may return a note on what came of it.
Waiting = Generator[float, None, Any]
Place = tuple[float, float]
Looking = Generator[float, None, Place]

_seen: Place = (-1.0, -1.0)  # where Blender has last handled the mouse


class ICYMOON_TEST_OT_watch(bpy.types.Operator):
    """Note where the mouse is, and leave every event to what it is for"""

    bl_idname = "icymoon_test.watch"
    bl_label = "Watch the Mouse"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        global _seen
        _seen = event.mouse_x, event.mouse_y
        return {"PASS_THROUGH"}


def seen() -> Place:
    """Where a window that is watched has last handled the mouse, in that window's pixels."""
    return _seen


def check(holds: object, otherwise: str) -> None:
    """Raise AssertionError if something does not hold."""
    if not holds:
        raise AssertionError(otherwise)


# ---- where things are -----------------------------------------------------------------------------------------------


def manager() -> bpy.types.WindowManager:
    return bpy.context.window_manager


def window() -> bpy.types.Window:
    return manager().windows[0]


def area() -> bpy.types.Area:
    """The 3D View."""
    return next(a for a in window().screen.areas if a.type == "VIEW_3D")


def region(kind: str) -> bpy.types.Region:
    """A region of the 3D View; 'UI' is the sidebar."""
    return next(r for r in area().regions if r.type == kind)


def in_region(kind: str) -> AbstractContextManager[None]:
    """A context as if the mouse were in that region of the 3D View."""
    return bpy.context.temp_override(window=window(), area=area(), region=region(kind))


def middle(kind: str) -> Place:
    """The middle of a region of the 3D View, of which the sidebar covers a part."""
    where = region(kind)
    return where.x + where.width / 2, where.y + where.height / 2


# ---- what a person does ---------------------------------------------------------------------------------------------


def xdotool(*words: object) -> None:
    """Mouse and keys, through the X server."""
    subprocess.run(["xdotool", *map(str, words)], check=True, timeout=PATIENCE_S)


def until(done: Callable[[], object], what: str) -> Waiting:
    """Wait until something holds."""
    waited_s, since = 0.0, time.monotonic()
    while not done():
        check(waited_s < PATIENCE_S, f"{what} took more than {PATIENCE_S:.0f} s")
        yield TICK_S
        now = time.monotonic()
        waited_s, since = waited_s + min(now - since, MAX_TURN_S), now


def point(x: float, y: float) -> None:
    """Move the mouse to a place in Blender's window; y counts from below."""
    xdotool("mousemove", int(x), int(window().height - y))


def to(x: float, y: float) -> Waiting:
    """Move the mouse and wait until Blender has handled that. Not while a menu or a field has the mouse."""
    begin = time.monotonic()
    for turn in range(10_000):
        point(x + turn % 2, y)  # a mouse that is there already has to move to be noticed
        asked = time.monotonic()
        while time.monotonic() < asked + 2.0:
            yield 0.01
            if abs(_seen[0] - x) < 3 and abs(_seen[1] - y) < 3:
                return
        check(asked < begin + PATIENCE_S, f"Blender does not follow the mouse to {x:.0f}, {y:.0f}")


def away() -> Waiting:
    """Take the mouse out of the sidebar, so that no tooltip covers it."""
    yield from to(*middle("WINDOW"))


def key(name: str) -> Waiting:
    """Press a key."""
    xdotool("key", name)
    yield TICK_S


def write_text(text: str) -> Waiting:
    """Type letters, slowly enough for xdotool to find each on the keyboard."""
    for letter in text:
        xdotool("type", letter)
        yield 2 * TICK_S


def over_button(operator: str, **options: str | None) -> bool:
    """Whether the mouse is over a button of that operator: Blender tells by copying its Python command. An option None
    is not set by the button."""
    with in_region("UI"):
        if not bpy.ops.ui.copy_python_command_button.poll():
            return False
        manager().clipboard = ""
        bpy.ops.ui.copy_python_command_button()
    command = manager().clipboard
    command = command.replace("'", '"')  # which are around the items of a choice
    return command.startswith(f"bpy.ops.{operator}(") and all(
        f"{key}=" not in command if value is None else f'{key}="{value}"' in command for key, value in options.items()
    )


def over_setting(path: str, of: str = "") -> bool:
    """Whether the mouse is over the field of a setting, or of any setting ``of`` a group."""
    with in_region("UI"):
        if not bpy.ops.ui.copy_data_path_button.poll():
            return False
        manager().clipboard = ""
        bpy.ops.ui.copy_data_path_button()
    found = manager().clipboard  # of the scene's settings with a dot, of the window manager's field without one
    return found.endswith(path) and (not of or f".{of}" in found)


def _look(
    recognised: Callable[[], bool], columns: tuple[float, ...], start: float = 0.0
) -> Generator[float, None, Place | None]:
    """Look all over the sidebar, rows nearest to ``start`` (down from its top) first."""
    sidebar = region("UI")
    # At the very edge a click would drag the edge.
    for down in sorted(range(20, sidebar.height - 12, 12), key=lambda down: abs(down - start)):
        for across in columns:
            place = sidebar.x + across * sidebar.width, sidebar.y + sidebar.height - down
            yield from to(*place)
            yield 0.02  # our watcher sees the mouse before the sidebar does
            if recognised():
                yield 2 * TICK_S  # panels slide when what is in them changes
                if recognised():
                    return place
    return None


#: Where buttons are looked for across the sidebar: left and right in a row of two, bare icons at its end, and two
#: of three.
COLUMNS = (0.35, 0.66, 0.74, 0.82, 0.9, 0.15, 0.48)
ICONS = ("icymoon.add_preset", "icymoon.vary", "icymoon.variation_remove")
#: Where the buttons in the headers of panels are, across the sidebar.
HELP = 0.785
#: Height of the picture of the scene, in heights of a button, and of a button.
PICTURE_ROWS, BUTTON_PX = 8, 20
#: Of the pictures of all scenes, when they are open: how many are in a row, and from one to the next across and down.
PICTURES_IN_A_ROW, PICTURE_PX = 8, (147, 168)
_found = 0.0  # how far down the last button was


def find(operator: str, **options: str | None) -> Looking:
    """Look for a button in the sidebar by mouse, first near the last one, then page by page; returns its place."""
    global _found
    yield from away()
    # Buttons with options are mostly icons of a table, the others as wide as half a row.
    likely = COLUMNS[2:] if any(options.values()) or operator in ICONS else COLUMNS[:2]
    place = yield from _look_on_every_page(lambda: over_button(operator, **options), (likely, COLUMNS), _found)
    assert place is not None, f"no button of {operator} was found in the sidebar"
    _found = region("UI").y + region("UI").height - place[1]
    return place


def press(operator: str, **options: str | None) -> Waiting:
    """Find a button and click it."""
    yield from find(operator, **options)
    xdotool("click", 1)
    yield TICK_S


def scrolled() -> float:
    """How far down the sidebar is scrolled."""
    return -region("UI").view2d.region_to_view(0, 0)[1]


def scroll(clicks: int) -> Generator[float, None, bool]:
    """Scroll the sidebar, which the mouse must be in, down (or up, below 0); whether it moved."""
    before = scrolled()
    xdotool("click", "--repeat", abs(clicks), "--delay", 10, 5 if clicks > 0 else 4)
    yield 3 * TICK_S
    while True:  # until it rests
        now = scrolled()
        yield 3 * TICK_S
        if scrolled() == now:
            return abs(now - before) > 1


def _look_on_every_page(
    recognised: Callable[[], bool], passes: Sequence[tuple[float, ...]], start: float = 0.0
) -> Generator[float, None, Place | None]:
    """Look where the sidebar is scrolled to, on the page below and the one above, then on all pages from the top, each
    time in the columns of one of the ``passes``. What slid away under the mouse is where it belongs the second time."""
    page = int(region("UI").height / 60)
    for clicks in (0, page, -2 * page):  # with all panels open, all pages take a quarter of an hour
        if clicks:
            yield from to(*middle("UI"))
            yield from scroll(clicks)
        for columns in passes:
            if place := (yield from _look(recognised, columns, 0.0 if clicks else start)):
                return place
    for columns in passes:
        yield from to(*middle("UI"))
        yield from scroll(-400)
        while True:
            if place := (yield from _look(recognised, columns)):
                return place
            yield from to(*middle("UI"))
            if not (yield from scroll(page)):
                break
    return None


def find_setting(path: str) -> Looking:
    """Look for a setting's field with the mouse, page after page of the sidebar; returns its place."""
    place = yield from _look_on_every_page(lambda: over_setting(path), [(0.7,)] * 2)
    assert place is not None, f"no field of {path} was found in the sidebar"
    return place


def open_the_tab() -> Waiting:
    """Show the sidebar and click down its tabs until ours is shown."""
    yield from away()
    if region("UI").width < 100:
        yield from key("n")
    yield from until(lambda: region("UI").width > 100, "Showing the sidebar")
    yield 10 * TICK_S  # it slides in
    sidebar = region("UI")
    for down in range(15, 400, 12):
        yield from to(sidebar.x + sidebar.width - 10, sidebar.y + sidebar.height - down)
        xdotool("click", 1)
        yield 2 * TICK_S
        if sidebar.active_panel_category == "Icy Moon":
            break
    check(sidebar.active_panel_category == "Icy Moon", f"the tab shown is {sidebar.active_panel_category!r}")
    yield from away()


def over_the_pictures() -> Looking:
    """Go to the picture of the scene, which opens those of all scenes; returns the place of its middle.

    No command tells that the mouse is over it. It is above the row of presets, eight buttons high.
    """
    _, y = yield from find("icymoon.add_preset")
    place = region("UI").x + COLUMNS[0] * region("UI").width, y + (PICTURE_ROWS / 2 + 1) * BUTTON_PX
    yield from to(*place)
    return place


def point_at_picture(preset: str, middle: Place) -> None:
    """Go to the picture of a scene among those that are open, eight in a row, the last column at the window's edge.

    ``middle``: of the picture that opened them.
    """
    names = [name for name, *_ in sys.modules[f"{ADD_ON}.panels.previews"].load_choices()]
    row, column = divmod(names.index(preset), PICTURES_IN_A_ROW)
    point(window().width - PICTURE_PX[0] * (PICTURES_IN_A_ROW - column - 0.4), middle[1] - PICTURE_PX[1] * (row + 1))


def find_headers(most: int = 1000, **options: str) -> Generator[float, None, list[Place]]:
    """Places of the headers of panels that the sidebar shows now, from top to bottom, ``most`` of them. Each has a
    button that opens a page of the manual, by which it is found; ``options``: of that button."""
    sidebar = region("UI")
    groups: list[list[float]] = []  # heights at which the mouse is over the same button
    for down in range(20, sidebar.height - BUTTON_PX, 5):  # at the very edge a click would drag the edge
        y = sidebar.y + sidebar.height - down
        yield from to(sidebar.x + HELP * sidebar.width, y)
        yield 0.02  # our watcher sees the mouse before the sidebar does
        if over_button("icymoon.open_manual", **options):
            if not groups or groups[-1][0] - y > BUTTON_PX:
                groups.append([])
            groups[-1].append(y)
        elif len(groups) == most:
            break
    # In the middle of a header: at its edge a click is lost.
    return [(sidebar.x + COLUMNS[0] * sidebar.width, sum(group) / len(group)) for group in groups[:most]]


def drag_over(headers: Sequence[Place]) -> Waiting:
    """Drag up over the headers of closed panels one below the other, which opens them all."""
    # Near the upper edge of the first: Blender opens what the mouse has passed.
    x, first, last, count = headers[0][0], headers[0][1] + 0.4 * BUTTON_PX, headers[-1][1], 5 * len(headers)
    yield from to(x, last)
    xdotool("mousedown", 1)
    for k in range(count):
        point(x, last + (first - last) * k / (count - 1))
        yield 0.05
    yield 5 * TICK_S  # a button that is let go before Blender has seen the last move leaves the first panel closed
    xdotool("mouseup", 1)
    yield 5 * TICK_S


def turn_choice(path: str, clicks: int) -> Waiting:
    """Find the menu of a choice and turn the wheel with Ctrl over it, down (or up, below 0)."""
    yield from find_setting(path)
    xdotool("keydown", "ctrl")
    xdotool("click", "--repeat", abs(clicks), "--delay", 60, 5 if clicks > 0 else 4)
    xdotool("keyup", "ctrl")
    yield 3 * TICK_S


def open_preferences() -> Waiting:
    """Open the preferences in a window of their own, at the page of the extension, with what Check says there."""
    with in_region("WINDOW"):
        bpy.ops.screen.userpref_show("INVOKE_DEFAULT", section="ADDONS")
    yield from until(lambda: len(manager().windows) == 2, "Opening the preferences")
    page = manager().windows[1]
    manager().addon_search = "icy"
    listed = next(each for each in addon_utils.modules(refresh=False) if each.__name__ == ADD_ON)
    with bpy.context.temp_override(window=page, area=page.screen.areas[0]):
        if not addon_utils.module_bl_info(listed)["show_expanded"]:
            bpy.ops.preferences.addon_expand(module=ADD_ON)
    if not sys.modules[f"{ADD_ON}.operators.preferences"].findings:
        check(bpy.ops.icymoon.check_evaluator() == {"FINISHED"}, "the evaluator is not ready")
    for part in page.screen.areas:
        part.tag_redraw()
    yield 15 * TICK_S


def close_second_window(what: str) -> Waiting:
    """Close the window that was opened beside the first."""
    with bpy.context.temp_override(window=manager().windows[1]):
        bpy.ops.wm.window_close()
    yield from until(lambda: len(manager().windows) == 1, f"Closing {what}")


def drawing_s() -> float:
    """Seconds that Blender needs now to draw its whole window."""
    began = time.perf_counter()
    with in_region("WINDOW"):
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
    return time.perf_counter() - began


def screenshot(folder: Path, name: str) -> Waiting:
    """Save what the screen shows, after a redraw."""
    yield 6 * TICK_S
    path = folder / f"{len(list(folder.glob('*.png'))) + 1:02d}_{name}.png"
    shot = subprocess.Popen(["import", "-window", "root", str(path)])
    yield from until(lambda: shot.poll() is not None, "A screenshot")
    check(shot.returncode == 0 and path.stat().st_size > 20_000, f"the screenshot {path.name} is empty")


def start_watching() -> None:
    """Let Blender tell where it has handled the mouse, also after another file was opened."""
    if not hasattr(bpy.types, "ICYMOON_TEST_OT_watch"):
        bpy.utils.register_class(ICYMOON_TEST_OT_watch)
    with in_region("WINDOW"):
        bpy.ops.icymoon_test.watch("INVOKE_DEFAULT")
