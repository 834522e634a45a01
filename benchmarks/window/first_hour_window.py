"""A newcomer's steps in Blender's window, with mouse and keys, and the time of each; runs inside Blender.

    blender --python benchmarks/window/first_hour_window.py -- FOLDER ZIP STARTED

FOLDER gets steps.json, a screenshot after each step, and the pair. ZIP is the extension, STARTED the Unix time at
which Blender was started.

Each step has three times. ``seconds`` is the clock's: buttons are found by moving the mouse over rows, which takes
longer than a user needs. ``machine`` is the part of it in which the user can only wait. ``user`` is what the
keystroke-level model (Card, Moran and Newell 1980) gives for the clicks, drags and keys of the step: the time of
somebody who knows where to click. Reading is in none of them.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "gui"))
import person
from person import ADD_ON, TICK_S, Waiting, away, check, in_region, key, manager, point, press, xdotool

FOLDER, ARCHIVE = Path(sys.argv[-3]), Path(sys.argv[-2])
STARTED = float(sys.argv[-1])
PRESET = "scenes/enceladus_fresh_snow"
SAMPLES = "8"
#: Seconds of the keystroke-level model: to think, point and click; to think and press a key; to think and drag.
CLICK_S, KEY_S, DRAG_S = 1.35 + 1.1 + 0.2, 1.35 + 0.28, 1.35 + 2 * (1.1 + 0.1)

steps: list[dict[str, Any]] = [{}]


def module(name: str) -> ModuleType:
    """A module of the installed extension."""
    return sys.modules[f"{ADD_ON}.{name}"]


def settings() -> bpy.types.PropertyGroup:
    return person.window().scene.icymoon


def page(kind: str) -> bpy.types.Window | None:
    """The separate window of an editor, such as IMAGE_EDITOR."""
    return next((window for window in manager().windows[1:] if window.screen.areas[0].type == kind), None)


def by_user(seconds: float) -> None:
    """Count the user's actions in this step."""
    steps[-1]["user"] += seconds


def by_machine(done: Callable[[], object], what: str, patience_s: float = person.PATIENCE_S) -> Waiting:
    """Wait for the machine, as the user does, and count the time."""
    start = time.monotonic()
    while not done():
        check(time.monotonic() < start + patience_s, f"{what} took more than {patience_s:.0f} s")
        yield TICK_S
    steps[-1]["machine"] += time.monotonic() - start


def screenshot(name: str) -> Waiting:
    yield from person.screenshot(FOLDER, name)


# ---- the steps ------------------------------------------------------------------------------------------------------


def drop_the_zip() -> Waiting:
    """Drop the zip into the window, OK."""
    yield from key("Escape")  # the splash screen
    by_user(CLICK_S)
    with in_region("WINDOW"):  # as Blender does for a file that is dropped
        bpy.ops.extensions.package_install_files("INVOKE_DEFAULT", url=str(ARCHIVE))
    by_user(DRAG_S)
    yield 10 * TICK_S
    yield from screenshot("dropped")
    yield from key("Return")
    by_user(CLICK_S)
    yield from by_machine(lambda: ADD_ON in bpy.context.preferences.addons, "Installing the zip")


def open_the_tab() -> Waiting:
    """N, then the tab Icy Moon."""
    yield from person.open_the_tab()
    by_user(KEY_S + CLICK_S)
    settings().dataset.folder = str(FOLDER / "pairs")  # not into the home folder


def choose_a_picture() -> Waiting:
    """Click the picture, then a scene, until the view shows it."""
    middle = yield from person.over_the_pictures()
    xdotool("click", 1)
    by_user(CLICK_S)
    yield 15 * TICK_S  # the pictures open
    yield from screenshot("pictures")
    person.point_at_picture(PRESET, middle)
    yield 5 * TICK_S
    xdotool("click", 1)
    by_user(CLICK_S)
    yield from by_machine(lambda: any(c.get("icymoon") == "scene" for c in bpy.data.collections), "Showing the scene")
    drawn: list[bool] = []
    bpy.app.timers.register(lambda: drawn.append(True), first_interval=TICK_S)
    yield from by_machine(lambda: drawn, "Drawing the scene")
    check(settings().preset == PRESET, f"at the place of {PRESET} is {settings().preset}")


def lower_the_samples() -> Waiting:
    """Set Quality and Speed > Samples to 8, as in Draft, whose denoiser may be missing."""
    sidebar, page = person.region("UI"), module("operators.manual").find_page_of_topic("quality")
    _, y = yield from person.find("icymoon.open_manual", page=page)  # in the header of the panel
    yield from person.to(sidebar.x + 0.35 * sidebar.width, y)
    xdotool("click", 1)
    by_user(CLICK_S)
    yield 5 * TICK_S
    yield from person.find_setting("quality.samples")
    xdotool("click", "--repeat", 2, "--delay", 60, 1)
    yield 5 * TICK_S
    yield from key("ctrl+a")
    yield from person.write_text(SAMPLES)
    yield from key("Return")
    by_user(CLICK_S + KEY_S)
    yield from by_machine(lambda: settings().quality.samples == int(SAMPLES), "Lowering the samples")
    yield from person.to(*person.middle("UI"))
    yield from person.scroll(-400)


def ended(what: str) -> Waiting:
    """Wait until a job has begun and ended, without a time limit; AssertionError with the job's message if it
    failed."""
    session = module("operators.session").session
    yield from by_machine(lambda: session.job, f"Starting {what}")
    job = session.job
    yield from by_machine(lambda: session.job is not job, what, 1000.0)
    check(not job.failure, job.failure)


def render_stereo_pair() -> Waiting:
    """Render Stereo Pair, until it is on the disk and on the screen; close its window."""
    yield from press("icymoon.render_pair")
    by_user(CLICK_S)
    yield from ended("Rendering")
    check(list((FOLDER / "pairs").glob("pairs/*/pair.json")), "there is no pair")
    yield from by_machine(lambda: page("IMAGE_EDITOR"), "Showing the pair")
    yield from screenshot("pair")
    with bpy.context.temp_override(window=page("IMAGE_EDITOR")):
        bpy.ops.wm.window_close()
    by_user(CLICK_S)


def allow_online_access() -> Waiting:
    """Click Blender's button in the question, which no operator can trigger: below the text, above OK."""
    x, y = person.seen()
    system = bpy.context.preferences.system
    for down in range(12, 50, 6):  # the question opens above and below the button that asked
        point(x, y - down)
        yield 2 * TICK_S
        xdotool("click", 1)
        yield 3 * TICK_S
        if system.use_online_access:
            return
    raise AssertionError("the question has no button that allows online access")


def install_the_evaluator() -> Waiting:
    """Evaluate, Allow Online Access, Install and Evaluate, until the evaluation begins."""
    yield from press("icymoon.evaluate")
    by_user(CLICK_S)
    yield 15 * TICK_S  # the question opens
    yield from screenshot("question")
    yield from allow_online_access()
    by_user(CLICK_S)
    yield from screenshot("allowed")
    yield from key("Return")
    by_user(CLICK_S)
    yield from away()
    yield from ended("the installation")


def evaluate() -> Waiting:
    """The evaluation, until the panel shows the metrics."""
    yield from ended("Evaluating")
    check(module("operators.results").summary(bpy.context.scene), "there are no metrics")
    yield from away()
    yield 10 * TICK_S


STEPS = (
    drop_the_zip,
    open_the_tab,
    choose_a_picture,
    lower_the_samples,
    render_stereo_pair,
    install_the_evaluator,
    evaluate,
)


def processor_s() -> float:
    """Processor seconds of this Blender and of its ended child processes."""
    return sum(os.times()[:4])


def keep_steps() -> None:
    """Write the measurements so far, so that they outlive a killed Blender."""
    (FOLDER / "steps.json").write_text(json.dumps(steps, indent=1))


def walk() -> Waiting:
    person.start_watching()
    waited = time.time() - STARTED
    steps[-1].update(step="Blender's window appears", seconds=waited, machine=waited, user=0.0, cpu=processor_s())
    for step in STEPS:
        start, cpu = time.monotonic(), processor_s()
        record = {
            "step": (step.__doc__ or "").rstrip("."),
            "machine": 0.0,
            "user": 0.0,
            "seconds": 0.0,
            "cpu": 0.0,
            "failed": True,
        }
        steps.append(record)
        yield from step()
        record.update(seconds=time.monotonic() - start, cpu=processor_s() - cpu, failed=False)
        keep_steps()
        yield from screenshot(step.__name__)


def tick(walking: Waiting) -> float | None:
    try:
        return next(walking)
    except StopIteration:
        bpy.ops.wm.quit_blender()
    except BaseException:
        traceback.print_exc()
        keep_steps()
        subprocess.run(["import", "-window", "root", str(FOLDER / "99_failed.png")], check=False)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(7)
    return None


walking = walk()
bpy.app.timers.register(lambda: tick(walking), first_interval=TICK_S, persistent=True)
