"""Drive the installed extension in a real Blender as a person does; runs inside it.

    blender --python tests/gui/drive.py -- FOLDER

Mouse and keyboard are xdotool's, screenshots are ImageMagick's, so they show what a person sees.
Every step is written to FOLDER/steps.json; an exception anywhere ends Blender with status 7.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
DATASET = FOLDER / "dataset"
TICK_S = 0.1
F3 = "69"  # as a key code: given its name, xdotool may press Alt with it
Waiting = Iterator[float]

steps: list[dict] = []
ticks: list[float] = []  # when Blender let us run, to tell whether its window was blocked


# ---- what a person does ---------------------------------------------------------------------------------------------

def xdotool(*words: object) -> None:
    subprocess.run(["xdotool", *map(str, words)], check=True, timeout=20)


def move_to(x: float, y: float) -> None:
    """Move the mouse to a place in Blender's window; y counts from below."""
    xdotool("mousemove", int(x), int(window().height - y))


def key(name: str) -> Waiting:
    xdotool("key", name)
    yield 0.5


def screenshot(name: str) -> Waiting:
    """Save what the screen shows, after a redraw."""
    yield 0.6
    path = FOLDER / f"{len(list(FOLDER.glob('*.png'))) + 1:02d}_{name}.png"
    shot = subprocess.Popen(["import", "-window", "root", str(path)])
    while shot.poll() is None:
        yield TICK_S
    check(shot.returncode == 0 and path.stat().st_size > 20_000, f"the screenshot {path.name} is empty")


def check(holds: object, otherwise: str) -> None:
    if not holds:
        raise AssertionError(otherwise)


# ---- where things are -----------------------------------------------------------------------------------------------

def window() -> bpy.types.Window:
    return bpy.context.window_manager.windows[0]


def area() -> bpy.types.Area:
    return next(a for a in window().screen.areas if a.type == "VIEW_3D")


def region(kind: str) -> bpy.types.Region:
    return next(r for r in area().regions if r.type == kind)


def in_region(kind: str) -> object:
    """A context as if the mouse were in that region of the 3D View."""
    return bpy.context.temp_override(window=window(), area=area(), region=region(kind))


def middle(kind: str) -> tuple[float, float]:
    where = region(kind)
    return where.x + where.width / 2, where.y + where.height / 2


def over_button(operator: str) -> bool:
    """Whether the mouse is over a button of that operator: Blender tells by copying its Python command."""
    with in_region("UI"):
        if not bpy.ops.ui.copy_python_command_button.poll():
            return False
        window_manager().clipboard = ""
        bpy.ops.ui.copy_python_command_button()
    return window_manager().clipboard.startswith(f"bpy.ops.{operator}(")


def window_manager() -> bpy.types.WindowManager:
    return bpy.context.window_manager


def find(operator: str) -> Iterator:
    """Look for a button in the sidebar with the mouse, from above; returns its place."""
    sidebar = region("UI")
    move_to(*middle("WINDOW"))
    yield 0.5
    for across in (0.35, 0.75):
        for down in range(20, sidebar.height, 9):
            place = sidebar.x + sidebar.width * across, sidebar.y + sidebar.height - down
            move_to(*place)
            yield 0.12
            if over_button(operator):
                yield 0.4  # it may have been the button before, if Blender was busy
                if over_button(operator):
                    return place
    raise AssertionError(f"no button of {operator} was found in the sidebar")


def press(operator: str) -> Waiting:
    """Find a button and click it."""
    yield from find(operator)
    xdotool("click", 1)


def until(done: Callable[[], object], what: str, seconds: float) -> Waiting:
    """Wait until something holds."""
    end = time.monotonic() + seconds
    while not done():
        check(time.monotonic() < end, f"{what} took more than {seconds:.0f} s")
        yield TICK_S


def built() -> bool:
    return any(c.get("icymoon") == "scene" for c in bpy.data.collections)


def jobs() -> object:
    return sys.modules["bl_ext.user_default.icymoon.operators.jobs"]


def children() -> list[str]:
    """Processes that Blender has started and that are there, dead ones that were not waited for too."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, rest = stat.read_text().rsplit(")", 1)
        except OSError:
            continue
        if int(rest.split()[1]) == os.getpid():
            found.append(f"{name}) {rest.split()[0]}")
    return found


def pairs() -> list[Path]:
    return sorted(p.parent for p in DATASET.glob("pairs/*/pair.json"))


# ---- the steps ------------------------------------------------------------------------------------------------------

def open_the_tab() -> Waiting:
    """Show the sidebar and click down its tabs until ours is shown."""
    move_to(*middle("WINDOW"))
    area().spaces.active.show_region_ui = True
    yield 1.0
    sidebar = region("UI")
    for down in range(15, 400, 12):
        move_to(sidebar.x + sidebar.width - 10, sidebar.y + sidebar.height - down)
        xdotool("click", 1)
        yield 0.25
        if sidebar.active_panel_category == "Icy Moon":
            break
    check(sidebar.active_panel_category == "Icy Moon", f"the tab shown is {sidebar.active_panel_category!r}")
    move_to(*middle("WINDOW"))
    yield from screenshot("sidebar")


def open_the_presets() -> Waiting:
    """Open the menu of presets with the mouse and close it."""
    with in_region("WINDOW"):
        bpy.ops.wm.call_menu(name="ICYMOON_MT_presets")
    yield from screenshot("presets_menu")
    yield from key("Escape")


def load_europa() -> Waiting:
    with in_region("WINDOW"):
        check(bpy.ops.icymoon.load_preset("INVOKE_DEFAULT", preset="scenes/europa_rough_ice") == {"FINISHED"}, "failed")
    group = window().scene.icymoon
    check(group.preset == "scenes/europa_rough_ice", "the preset is not remembered")
    group.rig.width_px, group.rig.height_px = 320, 240
    group.terrain.resolution = 257
    group.quality.samples = 4
    group.dataset.folder = str(DATASET)
    yield 0.3


def build_by_mouse() -> Waiting:
    yield from press("icymoon.build_scene")
    yield from until(built, "Build Scene", 60)
    move_to(*middle("WINDOW"))
    yield 3.0
    yield from screenshot("built")
    # Without a graphics card every redraw of the lit view takes seconds; what follows is about the sidebar.
    area().spaces.active.shading.type = "SOLID"
    yield 1.0


def undo_and_redo() -> Waiting:
    before = len(bpy.data.objects)
    with in_region("WINDOW"):
        bpy.ops.ed.undo()
    check(not built(), "undo left the collection")
    yield 0.5
    with in_region("WINDOW"):
        bpy.ops.ed.redo()
    check(built() and len(bpy.data.objects) == before, "redo did not bring the scene back")
    yield 0.5


def find_setting(path: str) -> Iterator:
    """Look for a setting's field with the mouse, page after page of the sidebar; returns its place."""
    sidebar = region("UI")
    for _ in range(8):
        for down in range(40, sidebar.height, 11):
            place = sidebar.x + sidebar.width * 0.7, sidebar.y + sidebar.height - down
            move_to(*place)
            yield 0.1
            with in_region("UI"):
                if bpy.ops.ui.copy_data_path_button.poll():
                    window_manager().clipboard = ""
                    bpy.ops.ui.copy_data_path_button()
            if window_manager().clipboard.endswith(path):
                return place
        xdotool("click", "--repeat", 12, "--delay", 20, 5)
        yield 0.5
    raise AssertionError(f"no field of {path} was found in the sidebar")


def heights() -> list[float]:
    """Heights of some of the ground's vertices."""
    mesh = bpy.data.objects["Icy Moon Terrain"].data
    return [mesh.vertices[k * len(mesh.vertices) // 50].co.z for k in range(50)]


def shown() -> bool:
    """Whether what is built shows the settings, be it coarsely."""
    scenes, preview = (sys.modules[f"bl_ext.user_default.icymoon.nodes.{name}"] for name in ("scene", "preview"))
    description = sys.modules["bl_ext.user_default.icymoon.settings"]
    there, settings = scenes.find(window().scene), description.from_group(window().scene.icymoon)
    before = description.merged(there.settings, there.preview)
    return (not there.edited and preview.geometry(before) == preview.geometry(settings)
            and before["light"] == settings["light"])


def previewing() -> bool:
    return bool(sys.modules["bl_ext.user_default.icymoon.nodes.scene"].find(window().scene).preview)


def slide_by_mouse() -> Waiting:
    """Drag the ruggedness, type another, undo both: the ground follows every time. Leaves a preview."""
    live = sys.modules["bl_ext.user_default.icymoon.operators.live"]
    scene, update, spans = window().scene, live.update, []
    live.update = lambda scene: (spans.append([time.monotonic()]), update(scene), spans[-1].append(time.monotonic()))[1]
    bpy.context.preferences.inputs.use_mouse_continuous = False  # or Blender and xdotool both move the mouse
    x, y = yield from find_setting("terrain.rms_slope_deg")
    before, value = heights(), scene.icymoon.terrain.rms_slope_deg
    xdotool("mousedown", 1)
    yield 0.2
    for k in range(30):
        move_to(x + 3 * k, y)
        yield 0.02
    check(previewing() and heights() != before, "the ground waits for the end of the drag")
    xdotool("mouseup", 1)
    yield 0.5
    check(scene.icymoon.terrain.rms_slope_deg > value, f"dragging made {value} {scene.icymoon.terrain.rms_slope_deg}")
    check(shown(), "the ground is not what the slider says")
    took = [end - start for start, end in spans]
    rate = (len(spans) - 1) / (spans[-1][1] - spans[0][1])
    check(len(spans) > 10, f"there were {len(spans)} updates")
    dragged = heights()
    yield from screenshot("live_dragged")
    move_to(region("UI").x + region("UI").width / 2, y)
    yield 0.5
    xdotool("click", "--repeat", 2, "--delay", 60, 1)
    yield 0.6
    xdotool("key", "ctrl+a")
    for letter in "35":
        xdotool("type", letter)
        yield 0.2
    yield from key("Return")
    yield 0.3
    check(scene.icymoon.terrain.rms_slope_deg == 35.0, f"typed 35, got {scene.icymoon.terrain.rms_slope_deg}")
    check(shown() and heights() != dragged, "the ground is not what was typed")
    move_to(*middle("WINDOW"))
    yield 0.3
    for expected, state in ((dragged, True), (before, False)):
        yield from key("ctrl+z")
        yield 0.5
        check(heights() == expected and previewing() == state and shown(), "undo left another ground")
    check(window().scene.icymoon.terrain.rms_slope_deg == value, "undo left another value")
    yield from key("ctrl+shift+z")
    yield 0.5
    check(heights() == dragged and previewing() and shown(), "redo did not bring the preview back")
    live.update = update
    # Something that an operator sets, so that there are many changes at once.
    with in_region("WINDOW"):
        bpy.ops.icymoon.load_preset("INVOKE_DEFAULT", preset="terrains/penitentes")
    yield 0.5
    check(shown(), "the ground is not that of the preset")
    bpy.data.objects["Cube"].hide_set(True)  # which undoing the first build has put in the picture again
    area().spaces.active.shading.type = "RENDERED"
    yield 4.0
    yield from screenshot("live_preset")
    area().spaces.active.shading.type = "SOLID"
    xdotool("click", "--repeat", 150, "--delay", 10, 4)
    yield 0.5
    return f"{len(spans)} updates, {rate:.1f} a second with redraws, {sum(took) / len(took) * 1e3:.0f} ms each"


#: Enough that a render is seen to advance.
SAMPLES = 64


def render_by_mouse() -> Waiting:
    """Render; the window must go on meanwhile and the sidebar must show how far it is."""
    check(previewing(), "there is no preview that could be rendered by mistake")
    window().scene.icymoon.quality.samples = SAMPLES
    yield from press("icymoon.render_pair")
    yield from until(lambda: jobs().current, "Starting the render", 10)
    check(not previewing(), "the scene was not built before the render")
    # Drawing the ground is Blender's, and slow where no graphics card is: that much is not blocking.
    began = time.perf_counter()
    with in_region("WINDOW"):
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
    drawing = time.perf_counter() - began
    start, fractions = len(ticks), set()
    yield from until(lambda: jobs().current is None or jobs().current.fraction > 0.02, "Progress", 60)
    check(jobs().current, "the render ended without progress")
    fractions.add(jobs().current.fraction)
    yield from screenshot("rendering")
    while jobs().current:
        fractions.add(jobs().current.fraction)
        yield TICK_S
    gap = max(b - a for a, b in zip(ticks[start:], ticks[start + 1:], strict=False))
    check(gap < 2.0 + 2.0 * drawing, f"the window was blocked for {gap:.1f} s, where drawing takes {drawing:.1f} s")
    check(len(pairs()) == 1, f"{len(pairs())} pairs are there")
    check(len(fractions) > 2, f"progress was {sorted(fractions)}")
    return f"longest gap {gap:.2f} s, {len(fractions)} stages of progress"


def escape_a_render() -> Waiting:
    window().scene.icymoon.quality.samples = 4000
    yield from press("icymoon.render_pair")
    yield from until(lambda: jobs().current and jobs().current.fraction > 0, "Progress", 60)
    check(list(DATASET.glob("pairs/*.part")), "nothing is being written")
    move_to(*middle("WINDOW"))
    yield from key("Escape")
    yield from until(lambda: jobs().current is None, "Cancelling", 10)
    yield 0.5
    check(not list(DATASET.glob("pairs/*.part")), "a half-written pair was left")
    check(not children(), f"processes were left: {children()}")
    check(len(pairs()) == 1, "the first pair is gone")
    yield from screenshot("cancelled")
    window().scene.icymoon.quality.samples = SAMPLES


def evaluate_by_mouse() -> Waiting:
    yield from press("icymoon.evaluate")
    yield from until(lambda: jobs().current, "Starting the evaluation", 10)
    yield from until(lambda: jobs().current is None, "Evaluating", 120)
    move_to(*middle("WINDOW"))
    check((DATASET / "evaluation_scene" / "report.html").is_file(), "there is no report")
    check(not children(), f"processes were left: {children()}")
    yield 2.0  # the panels slide into place
    yield from screenshot("evaluated")


def show_error() -> Waiting:
    yield from press("icymoon.show_error")
    yield from until(lambda: len(window_manager().windows) == 2, "Opening an Image Editor", 10)
    space = window_manager().windows[1].screen.areas[0].spaces.active
    check(space.type == "IMAGE_EDITOR" and space.image and space.image.size[0] > 0, "it shows no image")
    yield 1.0
    yield from screenshot("error_image")
    with bpy.context.temp_override(window=window_manager().windows[1]):
        bpy.ops.wm.window_close()
    yield 1.0


def measured_surface() -> Waiting:
    """What a matcher measured appears beside the true ground, also within the view of our objects only, and goes."""
    def there() -> list[bpy.types.Object]:
        return [item for item in bpy.data.objects if item.get("icymoon") == "measured surface"]

    yield from press("icymoon.show_surface")
    yield from until(there, "Showing the measured surface", 20)
    yield from until(lambda: there()[0].visible_in_viewport_get(area().spaces.active), "Taking it into this view", 10)
    move_to(*middle("WINDOW"))
    yield 3.0
    yield from screenshot("measured_surface")
    with in_region("WINDOW"):
        bpy.ops.icymoon.hide_surface()
    yield from until(lambda: not there(), "Removing the measured surface", 10)


def render_a_data_set() -> Waiting:
    """A plan from a file, its dry run, and its pairs; Esc, which means other things meanwhile, does not stop it."""
    plan, folder = FOLDER / "plan.toml", FOLDER / "set"
    plan.write_text('[plan]\ntitle = "Four Suns"\n[mesh]\nkind = "GRID"\n[terrain]\nresolution = 65\n[rig]\n'
                    'width_px = 64\nheight_px = 48\n[quality]\nsamples = 4\n[[sweep]]\nkind = "grid"\n'
                    'light.sun_elevation_deg = [10, 30, 50, 70]\n')
    group = window().scene.icymoon.dataset
    before, group.folder = group.folder, str(folder)
    operators = sys.modules["bl_ext.user_default.icymoon.operators.dataset"]
    with in_region("WINDOW"):
        check(bpy.ops.icymoon.open_plan(filepath=str(plan)) == {"FINISHED"}, "the plan could not be opened")
        bpy.ops.icymoon.plan_dry_run("INVOKE_DEFAULT")
    yield from until(lambda: jobs().current is None, "Dry Run", 60)
    check(operators.readout["lines"][:1] == ["4 pairs"], f"the dry run says {operators.readout['lines']}")
    with in_region("WINDOW"):
        bpy.ops.icymoon.render_dataset("INVOKE_DEFAULT")
    yield from until(lambda: operators.readout["last"], "The first pair", 120)
    yield from key("Escape")
    yield from screenshot("data_set")
    yield from until(lambda: jobs().current is None, "Render Data Set", 240)
    done = len(list(folder.glob("pairs/*/pair.json")))
    check(done == 4, f"{done} of 4 pairs are there")
    check(not children(), f"processes were left: {children()}")
    group.folder = before


def open_all_panels() -> Waiting:
    """Drag up over the closed headers, which opens them all, and look at them from top to bottom."""
    x, y = yield from find("icymoon.build_scene")
    panels = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("ICYMOON_PT_")]
    topics = sum(not hasattr(panel, "bl_parent_id") for panel in panels) - 1  # without the main panel
    first, last = y - 96, y - 96 - 28 * (topics - 1)  # of the topics' closed headers
    move_to(x, last)
    yield 0.3
    xdotool("mousedown", 1)
    for k in range(5 * topics):
        yield 0.05
        move_to(x, last + (first - last) * k / (5 * topics - 1))
    xdotool("mouseup", 1)
    yield 0.5
    settings = 0
    for k in range(2, 8):
        move_to(x, first - 24 * k)
        yield 0.3
        with in_region("UI"):
            settings += bpy.ops.ui.copy_data_path_button.poll()
    check(settings, "dragging over the headers opened no panel")
    for part in ("1", "2", "3", "4", "5"):
        yield from screenshot(f"panels_{part}")
        xdotool("click", "--repeat", 22, "--delay", 20, 5)
        yield 0.5
    xdotool("click", "--repeat", 150, "--delay", 10, 4)
    yield 0.5


def preferences_page() -> Waiting:
    """The extension's page in the preferences, the evaluator given there instead of by the environment."""
    add_on = bpy.context.preferences.addons["bl_ext.user_default.icymoon"]
    add_on.preferences.evaluator = os.environ.pop("ICYMOON_EVALUATOR")
    with in_region("WINDOW"):
        bpy.ops.screen.userpref_show("INVOKE_DEFAULT", section="ADDONS")
    move_to(window().width - 100, 100)
    yield 1.0
    window_manager().addon_search = "icy"
    page = window_manager().windows[-1]
    with bpy.context.temp_override(window=page, area=page.screen.areas[0]):
        bpy.ops.preferences.addon_expand(module="bl_ext.user_default.icymoon")
    check(bpy.ops.icymoon.check_evaluator() == {"FINISHED"}, "the evaluator is not ready")
    for part in page.screen.areas:
        part.tag_redraw()
    yield 1.0
    yield from screenshot("preferences")
    with bpy.context.temp_override(window=window_manager().windows[-1]):
        bpy.ops.wm.window_close()
    yield 0.5


def search_and_clear() -> Waiting:
    """F3, type, Return: Clear Scene."""
    move_to(*middle("WINDOW"))
    yield 0.5
    yield from key(F3)
    yield 2.0  # the first search goes through all menus
    for letter in "clear scene":
        xdotool("type", letter)
        yield 0.2
    yield 1.0
    yield from screenshot("search")
    yield from key("Return")
    yield from until(lambda: not built(), "Clear Scene by F3", 10)
    yield from screenshot("cleared")


STEPS = (open_the_tab, open_the_presets, load_europa, open_all_panels, build_by_mouse, undo_and_redo,
         slide_by_mouse, render_by_mouse, escape_a_render, evaluate_by_mouse)
#: What comes after the main job; driven where ICYMOON_GUI_ALL is set.
MORE = (measured_surface, render_a_data_set, search_and_clear, show_error, preferences_page)


def write(finished: bool) -> None:
    (FOLDER / "steps.json").write_text(json.dumps(
        {"blender": bpy.app.version_string, "finished": finished, "steps": steps}, indent=1))


def walk() -> Iterator[float]:
    yield 3.0  # the window appears
    for step in (*STEPS, *(MORE if os.environ.get("ICYMOON_GUI_ALL") else ())):
        start = time.monotonic()
        record = {"step": step.__name__, "ok": False, "seconds": 0.0, "note": ""}
        steps.append(record)
        record["note"] = (yield from step()) or ""
        record |= {"ok": True, "seconds": round(time.monotonic() - start, 1)}
        print(f"STEP {step.__name__} {record['seconds']} s {record['note']}", flush=True)


def tick(walking: Iterator[float]) -> float | None:
    ticks.append(time.monotonic())
    try:
        return next(walking)
    except StopIteration:
        write(finished=True)
        bpy.ops.wm.quit_blender()
    except BaseException as error:
        traceback.print_exc()
        steps[-1]["note"] = f"{type(error).__name__}: {error}"
        subprocess.run(["import", "-window", "root", str(FOLDER / "99_failed.png")], check=False)
        write(finished=False)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(7)
    return None


shutil.rmtree(FOLDER, ignore_errors=True)
FOLDER.mkdir(parents=True)
bpy.context.preferences.view.show_splash = False
walking = walk()
bpy.app.timers.register(lambda: tick(walking), first_interval=TICK_S)
