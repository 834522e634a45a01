"""A new user's steps in Blender's window, with mouse and keys, and the time of each; runs inside Blender.

    blender --python benchmarks/first_hour_window.py -- FOLDER ZIP STARTED

FOLDER gets steps.json, a screenshot after each step, and the pair. ZIP is the extension, STARTED the Unix time at
which Blender was started. Buttons are found by moving the mouse over rows, which takes longer than a user needs.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "gui"))
import person
from person import (
    ADD_ON,
    TICK_S,
    Looking,
    Waiting,
    away,
    check,
    find,
    find_setting,
    key,
    manager,
    press,
    until,
    xdotool,
)

FOLDER, ARCHIVE = Path(sys.argv[-3]), Path(sys.argv[-2])
STARTED = float(sys.argv[-1])
PRESET = "scenes/enceladus_fresh_snow"
#: The samples of the tutorial for a first look.
SAMPLES = "8"

steps: list[dict] = []


def module(name: str) -> Any:
    """A module of the installed extension."""
    return sys.modules[f"{ADD_ON}.{name}"]


def settings() -> bpy.types.PropertyGroup:
    return person.window().scene.icymoon


# ---- other windows than the first ------------------------------------------------------------------------------------

def page(kind: str) -> bpy.types.Window | None:
    """The window of its own that an editor has: PREFERENCES or FILE_BROWSER."""
    return next((window for window in manager().windows[1:] if window.screen.areas[0].type == kind), None)


def part(of: bpy.types.Window, *kinds: str) -> bpy.types.Region:
    """A region of that window: of one of these kinds, since Blender 5 has others."""
    return next(region for region in of.screen.areas[0].regions if region.type in kinds)


def on(of: bpy.types.Window, kind: str = "WINDOW") -> AbstractContextManager[None]:
    """A context as if the mouse were in that region of that window."""
    return bpy.context.temp_override(window=of, area=of.screen.areas[0], region=part(of, kind))


def opened(kind: str) -> Generator[float, None, bpy.types.Window]:
    """Wait for a window, and until it tells where it sees the mouse."""
    yield from until(lambda: page(kind), f"Opening {kind}")
    yield 5 * TICK_S
    with on(page(kind)):
        bpy.ops.icymoon_test.watch("INVOKE_DEFAULT")
    return page(kind)


def to(of: bpy.types.Window, x: float, y: float) -> Waiting:
    """Move the mouse to a place of that window and wait until Blender has handled that."""
    end = time.monotonic() + person.PATIENCE_S
    shift = 0
    while time.monotonic() < end:
        shift = 1 - shift  # a mouse that is there already has to move to be noticed
        xdotool("mousemove", int(of.x + x + shift), int(person.window().height - of.y - y))
        asked = time.monotonic()
        while time.monotonic() < asked + 1.0:
            yield 0.02
            if abs(person.seen()[0] - x) < 3 and abs(person.seen()[1] - y) < 3:
                return
    raise AssertionError(f"Blender does not follow the mouse to {x:.0f}, {y:.0f} of {of.screen.areas[0].type}")


def click(of: bpy.types.Window, kind: str, across: float, recognised: Callable[[], object]) -> Waiting:
    """Look down a region, ``across`` of its width from the left, for what is recognised under the mouse; click it."""
    where = part(of, kind)
    for down in range(8, where.height, 8):
        yield from to(of, where.x + across * where.width, where.y + where.height - down)
        if recognised():
            xdotool("click", 1)
            yield TICK_S
            return
    raise AssertionError(f"what is to be clicked was not found in {kind} of {of.screen.areas[0].type}")


def over(of: bpy.types.Window, command: str) -> bool:
    """Whether the mouse is over a button of that Python command in the window's main region."""
    with on(of):
        if not bpy.ops.ui.copy_python_command_button.poll():
            return False
        manager().clipboard = ""
        bpy.ops.ui.copy_python_command_button()
    return manager().clipboard.startswith(f"bpy.ops.{command}")


def preferences(section: str) -> Looking:
    """Open the preferences at a section; returns their window."""
    yield from away()
    yield from key("ctrl+comma")
    preferences = yield from opened("PREFERENCES")
    bar = part(preferences, "NAVIGATION_BAR", "UI")
    for down in range(40, bar.height, 12):  # below the search field that Blender 5 has
        yield from to(preferences, bar.x + bar.width / 2, bar.y + bar.height - down)
        xdotool("click", 1)
        yield 2 * TICK_S
        if bpy.context.preferences.active_section == section:
            yield 5 * TICK_S
            return preferences
    raise AssertionError(f"the preferences have no section {section}")


def close(of: bpy.types.Window) -> Waiting:
    """Close a window, as by the cross that a window manager gives it."""
    count = len(manager().windows)
    with bpy.context.temp_override(window=of):
        bpy.ops.wm.window_close()
    yield from until(lambda: len(manager().windows) < count, "Closing a window")


# ---- the steps ------------------------------------------------------------------------------------------------------

def install_from_disk() -> Waiting:
    """Edit > Preferences > Get Extensions: Allow Online Access, then the arrow > Install from Disk."""
    yield from key("Escape")  # the splash screen
    preferences_window = yield from preferences("EXTENSIONS")
    if not bpy.context.preferences.system.use_online_access:
        yield from click(preferences_window, "WINDOW", 0.75,
                         lambda: over(preferences_window, "extensions.userpref_allow_online("))
        yield from until(lambda: bpy.context.preferences.system.use_online_access, "Allowing online access")
    yield 10 * TICK_S
    head = part(preferences_window, "WINDOW")
    yield from to(preferences_window, head.x + head.width - 19, head.y + head.height - 18)
    xdotool("click", 1)
    yield 10 * TICK_S  # the menu
    yield from person.screenshot(FOLDER, "install_menu")
    yield from key("f")  # its letter of Install from Disk
    files = yield from opened("FILE_BROWSER")
    yield from person.screenshot(FOLDER, "install_file")
    field = part(files, "UI")
    yield from to(files, field.x + 0.3 * field.width, field.y + field.height / 2)
    xdotool("click", "--repeat", 2, "--delay", 60, 1)
    yield 5 * TICK_S
    yield from key("ctrl+a")
    xdotool("type", "--delay", 30, ARCHIVE)
    yield 2 * TICK_S
    yield from key("Return")
    parameters = files.screen.areas[0].spaces.active.params
    yield from until(lambda: parameters.filename == ARCHIVE.name, "Naming the zip")
    yield from key("Return")  # without which the field goes on in Blender 5
    yield 20 * TICK_S
    if page("FILE_BROWSER"):
        listed = part(files, "WINDOW")
        yield from to(files, listed.x + listed.width / 2, listed.y + listed.height / 4)
        yield from key("Return")
    yield from until(lambda: ADD_ON in bpy.context.preferences.addons, "Installing the zip")
    yield from person.screenshot(FOLDER, "installed")
    yield from close(page("PREFERENCES"))


def open_the_tab() -> Waiting:
    """N, then the tab Icy Moon."""
    yield from person.open_the_tab()


def choose_the_preset() -> Waiting:
    """The menu under the picture."""
    _, y = yield from find("icymoon.build_scene")
    names = [name for _, presets in module("panels.menu").presets_by_kind() for name, _ in presets]
    yield from person.to(person.region("UI").x + person.COLUMNS[0] * person.region("UI").width, y + 24)
    xdotool("click", 1)
    yield 10 * TICK_S
    yield from key("Home")
    for _ in range(names.index(PRESET)):
        yield from key("Down")
    yield from key("Return")
    yield from until(lambda: settings().preset == PRESET, "Choosing the preset")
    settings().dataset.folder = str(FOLDER / "pairs")  # not into the home folder


def build_scene() -> Waiting:
    """Build Scene, until the view has shown it once."""
    yield from press("icymoon.build_scene")
    yield from until(lambda: any(c.get("icymoon") == "scene" for c in bpy.data.collections), "Build Scene")
    yield 3 * TICK_S


def show_it_solid() -> Waiting:
    """Z, Solid: as in the tutorial, where there is no graphics card."""
    space = person.area().spaces.active
    yield from away()
    yield from key("z")
    yield 10 * TICK_S
    yield from key("6")  # its place in the pie
    yield from until(lambda: space.shading.type == "SOLID", "Showing it solid")
    yield 3 * TICK_S


def lower_the_samples() -> Waiting:
    """Render Quality > Samples to 8."""
    x, y = yield from find("icymoon.build_scene")
    panels = [cls for cls in module("panels").CLASSES if issubclass(cls, bpy.types.Panel)]
    titles = [cls.bl_label for cls in sorted(panels, key=lambda cls: getattr(cls, "bl_order", 0))
              if not hasattr(cls, "bl_parent_id")]
    told = 22 * len(module("operators.live_preview").lines(person.window().scene))  # above the closed headers
    yield from person.to(x, y - 134 - told - 28 * (titles.index("Render Quality") - 1))
    xdotool("click", 1)
    yield 5 * TICK_S
    yield from find_setting("quality.samples")
    xdotool("click", "--repeat", 2, "--delay", 60, 1)
    yield 5 * TICK_S
    yield from key("ctrl+a")
    yield from person.write_text(SAMPLES)
    yield from key("Return")
    yield from until(lambda: settings().quality.samples == int(SAMPLES), "Lowering the samples")
    yield from person.to(*person.middle("UI"))
    yield from person.scroll(-400)


def ended(what: str) -> Waiting:
    """Wait until a job has begun and ended, however long it takes."""
    jobs = module("operators.jobs")
    yield from until(lambda: jobs.current, f"Starting {what}")
    yield from away()
    yield 15 * TICK_S
    yield from person.screenshot(FOLDER, what.lower().replace(" ", "_"))
    while jobs.current:
        yield TICK_S


def render_stereo_pair() -> Waiting:
    """Render Stereo Pair, until it is on the disk and on the screen."""
    yield from press("icymoon.render_pair")
    yield from ended("Rendering")
    check(list((FOLDER / "pairs").glob("pairs/*/pair.json")), "there is no pair")
    yield from until(lambda: page("IMAGE_EDITOR"), "Showing the pair")
    yield from person.screenshot(FOLDER, "pair")
    yield from close(page("IMAGE_EDITOR"))


def install_the_evaluator() -> Waiting:
    """Preferences > Add-ons > Icy Moon > Install."""
    window = yield from preferences("ADDONS")
    yield from click(window, "WINDOW", 0.03, lambda: over(window, f'preferences.addon_expand(module="{ADD_ON}"'))
    yield 10 * TICK_S
    yield from click(window, "WINDOW", 0.75, lambda: over(window, "icymoon.install_evaluator("))
    jobs = module("operators.jobs")
    yield from until(lambda: jobs.current, "Starting the installation")
    yield 15 * TICK_S
    yield from person.screenshot(FOLDER, "installing_evaluator")
    while jobs.current:
        yield TICK_S
    found = module("preferences").findings
    check(any(each.subject == "Evaluator" and each.state == "ok" for each in found), "the evaluator was not installed")
    yield from person.screenshot(FOLDER, "evaluator_installed")
    yield from close(window)


def evaluate() -> Waiting:
    """Evaluate, until the panel shows the metrics."""
    yield from press("icymoon.evaluate")
    yield from ended("Evaluating")
    check(module("operators.results").summary(), "there are no metrics")
    yield from away()
    yield 10 * TICK_S


STEPS = (install_from_disk, open_the_tab, choose_the_preset, build_scene, show_it_solid, lower_the_samples,
         render_stereo_pair, install_the_evaluator, evaluate)


def processor_s() -> float:
    """Processor seconds of this Blender and of its processes that have ended."""
    return sum(os.times()[:4])


def walk() -> Waiting:
    person.start_watching()
    steps.append({"step": "Blender's window appears", "seconds": time.time() - STARTED, "cpu": processor_s()})
    for step in STEPS:
        start, cpu = time.monotonic(), processor_s()
        record = {"step": (step.__doc__ or "").rstrip("."), "seconds": 0.0, "cpu": 0.0, "failed": True}
        steps.append(record)
        yield from step()
        record.update(seconds=time.monotonic() - start, cpu=processor_s() - cpu, failed=False)
        yield from person.screenshot(FOLDER, step.__name__)


def tick(walking: Waiting) -> float | None:
    try:
        return next(walking)
    except StopIteration:
        (FOLDER / "steps.json").write_text(json.dumps(steps, indent=1))
        bpy.ops.wm.quit_blender()
    except BaseException:
        traceback.print_exc()
        (FOLDER / "steps.json").write_text(json.dumps(steps, indent=1))
        subprocess.run(["import", "-window", "root", str(FOLDER / "99_failed.png")], check=False)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(7)
    return None


walking = walk()
bpy.app.timers.register(lambda: tick(walking), first_interval=TICK_S, persistent=True)
