"""Drive the installed extension in a real Blender as a person does; runs inside it.

    blender --python tests/gui/drive.py -- FOLDER               all steps
    blender --python tests/gui/drive.py -- FOLDER first         those of a newcomer's first minutes
    blender --python tests/gui/drive.py -- FOLDER STEP STEP …   some, by their names

Mouse and keyboard are xdotool's, screenshots are ImageMagick's, so they show what a person sees.
Every step is written to FOLDER/steps.json; an exception anywhere ends Blender with status 7.
"""

from __future__ import annotations

import faulthandler
import importlib
import json
import os
import shutil
import subprocess
import sys
import time
import traceback
import types
import webbrowser
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import numpy.typing as npt
from mathutils import Matrix, Vector

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
import person
import scene_sequences
from contrast import measure_words
from lateness import Lateness
from person import (
    ADD_ON,
    COLUMNS,
    F3,
    TICK_S,
    Waiting,
    area,
    away,
    check,
    find,
    find_setting,
    in_region,
    key,
    manager,
    middle,
    point,
    press,
    region,
    scroll,
    start_watching,
    to,
    until,
    window,
    write_text,
    xdotool,
)

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
DATASET = FOLDER / "dataset"
#: Names of the steps; without any, all.
WANTED = sys.argv[sys.argv.index("--") + 2 :]
#: Light paths per pixel: enough that a render is seen to advance.
SAMPLES = 48

steps: list[dict[str, Any]] = []
ticks: list[tuple[float, float]] = []  # when Blender let us run, and when we were done


def screenshot(name: str) -> Waiting:
    yield from person.screenshot(FOLDER, name)


def module(name: str) -> Any:
    """A module of the installed extension."""
    return sys.modules[f"{ADD_ON}.{name}"]


def session() -> Any:
    return module("operators.session").session


def settings() -> bpy.types.PropertyGroup:
    return window().scene.icymoon


def holds(expected: object, measure: Callable[[], object]) -> bool:
    """Whether something measures as expected now."""
    return measure() == expected


def built() -> bool:
    return any(c.get("icymoon") == "scene" for c in bpy.data.collections)


def pairs() -> list[Path]:
    return sorted(p.parent for p in DATASET.glob("pairs/*/pair.json"))


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


def heights() -> list[float]:
    """Heights of some of the ground's vertices."""
    mesh = bpy.data.objects["Icy Moon Terrain"].data
    return [mesh.vertices[k * len(mesh.vertices) // 50].co.z for k in range(50)]


def shown() -> bool:
    """Whether what is built shows the settings, be it coarsely."""
    preview, description = module("nodes.preview"), module("settings.description")
    there, wanted = (
        module("nodes.build_scene").find_built(window().scene),
        (module("settings.blender.scene_properties").read_settings(settings())),
    )
    before = description.merged(there.settings, there.preview)
    return (
        not there.edited
        and preview.select_geometry(before) == preview.select_geometry(wanted)
        and before["light"] == wanted["light"]
    )


def previewing() -> bool:
    return bool(module("nodes.build_scene").find_built(window().scene).preview)


def ended() -> Waiting:
    """Wait until no job and no build runs and none of their processes is left."""
    yield from until(lambda: session().job is None and session().building is None, "Ending the job")
    yield from until(lambda: not children(), f"The end of {children()}")


def accept_in_browser(browser: bpy.types.Window) -> Waiting:
    """Press the button that accepts what a file browser shows."""
    accept = next(part for part in browser.screen.areas[0].regions if part.type == "EXECUTE")
    point(browser.x + accept.x + 0.92 * accept.width, browser.y + accept.y + accept.height / 2)
    yield 5 * TICK_S
    xdotool("click", 1)


def choose_in_browser(folder: Path, name: str, picture: str, **options: object) -> Waiting:
    """Choose a file (or with no ``name`` the folder) in the file browser that opens, with options of its operator, and
    take a picture of it before its button is clicked."""
    yield from until(lambda: len(manager().windows) == 2, "Opening the file browser")
    browser = manager().windows[1]
    space = browser.screen.areas[0].spaces.active
    yield from until(lambda: space.params, "Listing the files")
    space.params.directory = str(folder).encode()
    if name:  # a browser of folders has no name to set
        space.params.filename = name
    for key_, value in options.items():
        setattr(space.active_operator, key_, value)
    yield 10 * TICK_S
    yield from screenshot(picture)
    yield from accept_in_browser(browser)
    yield from until(lambda: len(manager().windows) == 1, "Closing the file browser")


# ---- the steps ------------------------------------------------------------------------------------------------------


def open_the_tab() -> Waiting:
    """The tab is opened once after the installation; then find it by mouse."""
    yield from until(lambda: region("UI").width > 100, "Opening the sidebar by itself")
    yield from until(lambda: region("UI").active_panel_category == "Icy Moon", "Opening the tab by itself")
    yield from screenshot("opened_by_itself")
    yield from person.open_the_tab()
    yield from screenshot("sidebar")


def load_europa() -> Waiting:
    """Choose a preset in the menu with mouse and keys, and make it small."""
    _, y = yield from find("icymoon.add_preset")
    kinds = module("panels.menu").group_presets_by_kind()
    scenes = [name for name, _ in dict(kinds)["Scenes"]]
    yield from to(region("UI").x + COLUMNS[0] * region("UI").width, y)  # left of the + button
    xdotool("click", 1)
    yield 20 * TICK_S  # for the menu in the picture; keys wait for it by themselves
    yield from screenshot("presets_menu")
    yield from key("Home")
    for _ in range([title for title, _ in kinds].index("Scenes")):
        yield from key("Down")
    yield from key("Right")  # into the menu of its kind
    yield 5 * TICK_S
    yield from key("Home")
    for _ in range(scenes.index("scenes/europa_rough_ice")):
        yield from key("Down")
    yield from key("Return")
    yield from until(lambda: settings().preset == "scenes/europa_rough_ice", "Loading a preset")
    settings().rig.width_px, settings().rig.height_px = 240, 180
    settings().mesh.error_px, settings().mesh.edge_px = 4.0, 24.0  # or drawing it takes seconds without a graphics card
    settings().quality.samples = 4
    settings().dataset.folder = str(DATASET)


def render_a_data_set() -> Waiting:
    """A plan from a file, its dry run, and its pairs; Esc, which means other things meanwhile, does not stop it."""
    plan, folder = FOLDER / "plan.toml", FOLDER / "set"
    plan.write_text(
        '[plan]\ntitle = "Four Suns"\n[mesh]\nkind = "GRID"\n[terrain]\nresolution = 65\n[rig]\n'
        'width_px = 64\nheight_px = 48\n[quality]\nsamples = 4\n[[sweep]]\nkind = "grid"\n'
        "light.sun_elevation_deg = [10, 30, 50, 70]\n"
    )
    group = window().scene.icymoon.dataset
    before, group.folder = group.folder, str(folder)
    operators = module("operators.dataset")
    with in_region("WINDOW"):
        check(bpy.ops.icymoon.open_plan(filepath=str(plan)) == {"FINISHED"}, "the plan could not be opened")
        bpy.ops.icymoon.plan_dry_run("INVOKE_DEFAULT")
    yield from until(lambda: session().job is None, "Dry Run")
    check(operators.readout["lines"][:1] == ["4 pairs"], f"the dry run says {operators.readout['lines']}")
    with in_region("WINDOW"):
        bpy.ops.icymoon.render_dataset("INVOKE_DEFAULT")
    yield from until(lambda: operators.readout["last"], "The first pair")
    yield from key("Escape")
    yield from screenshot("data_set")
    yield from until(lambda: session().job is None, "Render Data Set")
    done = len(list(folder.glob("pairs/*/pair.json")))
    check(done == 4, f"{done} of 4 pairs are there")
    check(not children(), f"processes were left: {children()}")
    group.folder = before


def vary_by_plus() -> Waiting:
    """+ beside the list of Vary This Scene: a search, some letters and Return."""
    varied = window().scene.icymoon.variations.varied
    yield from to(*middle("UI"))
    yield from scroll(400)  # down to the end, and up again to the data set
    yield from scroll(-5)
    yield from press("icymoon.vary")
    yield 15 * TICK_S  # the search opens
    yield from write_text("sun elev")
    yield from screenshot("vary_plus")
    yield from key("Return")
    yield from until(lambda: len(varied) == 1, "Adding a setting by +")
    check(varied[0].setting == "light.sun_elevation_deg", f"{varied[0].setting} varies")
    yield from away()
    yield from screenshot("vary_plus_added")
    yield from press("icymoon.variation_remove")
    yield from until(lambda: not varied, "Removing it")


def vary_by_mouse() -> Waiting:
    """Vary the Sun's elevation from the context menu of its field, render the variations and look at the curve."""
    group = window().scene.icymoon
    kept = group.dataset.folder, group.dataset.evaluate, group.dataset.methods
    group.dataset.folder, group.dataset.evaluate, group.dataset.methods = str(FOLDER / "varied"), True, "sgbm"
    size = group.rig.width_px, group.rig.height_px, group.terrain.resolution
    group.rig.width_px, group.rig.height_px, group.terrain.resolution = 160, 120, 129
    yield from to(*middle("UI"))
    yield from scroll(-400)
    place = yield from find_setting("light.sun_elevation_deg")
    xdotool("click", 3)
    yield 15 * TICK_S  # the menu opens
    yield from screenshot("vary_menu")
    yield from key("End")  # to the last entry, whichever the menu opened at
    yield from key("Return")
    yield 15 * TICK_S
    yield from screenshot("vary_dialog")
    yield from key("Return")
    yield from until(lambda: len(group.variations.varied) == 1, "Adding a setting that varies")
    varied = group.variations.varied[0]
    check(varied.setting == "light.sun_elevation_deg", f"{varied.setting} varies")
    varied.first, varied.last, varied.count = 20.0, 40.0, 2
    yield from to(*place)
    yield from scroll(400)  # down to the data set
    yield from screenshot("vary_panel")
    yield from press("icymoon.show_ends")
    yield from until(lambda: session().job, "Starting the pictures of the first and the last pair")
    yield from ended()
    check(all(module("operators.variation_pictures").find_icons(window().scene)), "there are no pictures of both ends")
    yield from away()
    yield from screenshot("vary_ends")
    yield from press("icymoon.render_variations")
    yield 15 * TICK_S
    yield from screenshot("vary_render")
    yield from key("Return")
    yield from until(lambda: session().job, "Starting to render the variations")
    yield from ended()
    folder = FOLDER / "varied_sun_elevation"
    check(len(list(folder.glob("pairs/*/pair.json"))) == 2, "not both variations are there")
    check(group.dataset.folder == str(FOLDER / "varied"), f"the scene's folder is now {group.dataset.folder}")
    yield from away()
    yield 10 * TICK_S  # the button of the curve appears
    yield from screenshot("vary_done")
    yield from to(*middle("UI"))
    yield from scroll(400)  # what is known of the pairs has moved the panels down
    yield from press("icymoon.show_curve")
    yield from until(lambda: len(manager().windows) == 2, "Opening an Image Editor")
    image = manager().windows[1].screen.areas[0].spaces.active.image
    check(image.name.startswith("Error against Sun Elevation"), f"the picture is {image.name}")
    yield 10 * TICK_S
    yield from screenshot("vary_curve")
    yield from person.close_second_window("the Image Editor")
    group.dataset.folder, group.dataset.evaluate, group.dataset.methods = kept
    group.rig.width_px, group.rig.height_px, group.terrain.resolution = size
    bpy.ops.ed.undo_push(message="Settings of the other steps")  # where an undo of a later step leads back to
    yield from to(*middle("UI"))
    yield from scroll(-400)


def evaluate_other_pairs() -> Waiting:
    """A pair that was not rendered here, chosen in the file browser, is measured and its report opened."""
    folder, shift = FOLDER / "other", 8
    texture = np.random.default_rng(1).integers(0, 256, (60, 90, 3)).repeat(2, axis=0).repeat(2, axis=1)
    folder.mkdir()
    for eye, first in (("left", 0), ("right", shift)):
        image = np.ascontiguousarray(texture[:, first : first + 160]).astype(np.uint8)
        (folder / f"{eye}_a.png").write_bytes(module("formats.png").encode_png(image))
    np.save(folder / "disparity_a.npy", np.full((120, 160), float(shift), np.float32))
    (folder / "pairs.toml").write_text(
        '[images]\nleft = "left_{pair}.png"\nright = "right_{pair}.png"\n[truth]\ndisparity = "disparity_{pair}.npy"\n'
        "[camera]\nfocal_px = 100\nbaseline_m = 0.1\n",
        encoding="utf-8",
    )
    opened: list[str] = []
    webbrowser.open, open_page = opened.append, webbrowser.open  # type: ignore[assignment]
    yield from to(*middle("UI"))
    yield from scroll(400)
    yield from press("icymoon.evaluate_folder")
    yield from choose_in_browser(folder, "", "other_pairs_folder")
    yield from until(lambda: session().job, "Starting the evaluation of other pairs")
    yield from ended()
    page = folder / "evaluation" / "report.html"
    yield from until(lambda: opened, "Opening the report")
    webbrowser.open = open_page
    check(opened == [page.as_uri()] and page.is_file(), f"what opens is {opened}")
    yield from away()
    yield from screenshot("other_pairs")
    yield from to(*middle("UI"))
    yield from scroll(-400)


def export_a_pair() -> Waiting:
    """The rendered pair as KITTI has it, chosen in the file browser; then maps of its ground, by this Blender."""
    if not pairs():
        yield from press("icymoon.render_pair")
        yield from until(lambda: len(manager().windows) == 2, "Rendering a pair to export")
        yield from person.close_second_window("the Image Editor")
    operator = module("operators.export_pairs").ICYMOON_OT_export_pairs
    for kind, file in (("kitti", "training/image_2/000000_10.png"), ("dem", f"{pairs()[0].name}/dem.tif")):
        yield from press("icymoon.export_pairs")
        yield from until(lambda: len(manager().windows) == 2, "Opening the file browser")
        browser = manager().windows[1]
        space = browser.screen.areas[0].spaces.active
        yield from until(partial(getattr, space, "params"), "Listing the files")
        check(space.params.filename == f"{DATASET.name}_export", f"the folder is called {space.params.filename}")
        space.active_operator.kind = kind
        yield 10 * TICK_S
        yield from screenshot(f"export_{kind}")
        session().exported.clear()
        yield from accept_in_browser(browser)
        yield from until(lambda: session().exported or session().job, "Starting the export")
        yield from ended()
        folder = DATASET.parent / f"{DATASET.name}_export"
        check(
            {done.folder for done in session().exported.values()} == {str(folder)},
            f"the export ended with {session().exported}",
        )
        check((folder / file).is_file(), f"{file} is not there")
        yield from away()
        yield from screenshot(f"exported_{kind}")
    check(operator.poll(bpy.context), "the next export cannot start")


def find_a_setting() -> Waiting:
    """Words in the field at the top of the sidebar, and by F3 in a window of its own; a field is changed there."""
    yield from to(*middle("UI"))
    yield from scroll(-400)
    before = settings().surface.albedo
    settings().surface.albedo = 0.5 * before
    take_a_step()
    yield from find_setting("icymoon_sought")
    xdotool("click", "--repeat", 2, "--delay", 60, 1)
    yield 6 * TICK_S
    yield from write_text("albedo")
    yield 6 * TICK_S
    yield from screenshot("sought")  # while it is typed
    yield from key("Return")
    yield from until(lambda: manager().icymoon_sought == "albedo", "Typing a word")
    yield from away()
    yield from screenshot("found")
    yield from find_setting("icymoon.surface.albedo")
    yield from find_setting("icymoon_sought")
    yield from key("BackSpace")
    yield from until(lambda: not manager().icymoon_sought, "Clearing the word")
    yield from away()
    yield from key("ctrl+z")
    yield from until(lambda: abs(settings().surface.albedo - before) < 1e-6, "Undo of the step before the search")
    yield from key(F3)
    yield 20 * TICK_S
    yield from write_text("find setting")
    yield from key("Return")
    yield 10 * TICK_S
    yield from write_text("baseline")
    yield 5 * TICK_S
    yield from screenshot("find_setting")  # which follows the typing
    yield from key("Return")
    yield 10 * TICK_S
    yield from screenshot("found_setting")
    yield from write_text("0.35")
    yield from screenshot("typed_setting")
    yield from key("Return")
    yield 5 * TICK_S
    check(
        abs(settings().rig.baseline_m - 0.35) < 1e-6, f"the baseline is {settings().rig.baseline_m} m after typing 0.35"
    )
    yield from key("Escape")
    yield 5 * TICK_S
    yield from key("ctrl+z")
    yield from until(lambda: abs(settings().rig.baseline_m - 0.35) > 1e-6, "Undoing the typed value")


def ground_from_an_object() -> Waiting:
    """A mesh that was modelled is the ground, and Ctrl Z takes it back."""
    before = settings().source.kind
    mesh = bpy.data.meshes.new("Dunes")
    x, y = np.meshgrid(np.linspace(-4.0, 4.0, 65), np.linspace(-4.0, 4.0, 65))
    corners = np.arange(64 * 65).reshape(64, 65)[:, :64].ravel()
    faces = corners[:, None] + [0, 1, 66, 65]
    mesh.from_pydata(np.stack([x, y, 0.15 * np.sin(2 * x)], axis=-1).reshape(-1, 3).tolist(), [], faces.tolist())
    dunes = bpy.data.objects.new("Dunes", mesh)
    window().scene.collection.objects.link(dunes)
    with in_region("WINDOW"):
        if area().spaces.active.local_view is not None:
            bpy.ops.view3d.localview(frame_selected=False)
        bpy.ops.object.select_all(action="DESELECT")
        dunes.select_set(True)
        bpy.context.view_layer.objects.active = dunes
        bpy.ops.ed.undo_push(message="Dunes")
        check(bpy.ops.icymoon.object_as_ground("INVOKE_DEFAULT", True) == {"RUNNING_MODAL"}, "the object was refused")
    yield from until(
        lambda: built() and not session().building and settings().source.kind == "MESH", "Building on the object"
    )
    low, high = (
        bound([corner[2] for corner in bpy.data.objects["Icy Moon Terrain"].bound_box]) for bound in (min, max)
    )
    check(abs(low + 0.15) < 0.01 and abs(high - 0.15) < 0.01, f"the ground is from {low} to {high} m")
    yield from away()
    yield from screenshot("ground_of_an_object")
    yield from key("ctrl+z")
    yield from until(lambda: settings().source.kind == before, "Undoing the ground of an object")


def rocks_where_painted() -> Waiting:
    """The mouse paints where rocks lie, Use Painted Mask builds them there, and Ctrl Z takes it back."""

    def rocks() -> int:
        item = next((item for item in bpy.data.objects if item.get("icymoon") == "rock"), None)
        return len(item.data.vertices) if item else 0

    settings().rocks.coverage = 0.15
    yield from until(lambda: rocks() > 10, "Rocks in the preview")
    before = rocks()
    with in_region("WINDOW"):
        check(bpy.ops.icymoon.paint_mask("INVOKE_DEFAULT", True, kind="ROCKS") == {"FINISHED"}, "nothing to paint on")
    yield from until(lambda: bpy.context.mode == "PAINT_WEIGHT", "Weight Paint mode")
    x, y = middle("WINDOW")
    for row in (-120, -60, 0):
        yield from to(x - 250, y + row)
        xdotool("mousedown", 1)
        for share in np.linspace(0.1, 1.0, 10):  # a stroke keeps the mouse to itself, so nothing tells of each move
            point(x - 250 + 400 * share, y + row - 20 * share)
            yield 2 * TICK_S
        xdotool("mouseup", 1)
        yield 5 * TICK_S
    sheet = bpy.context.active_object
    has_brush = bpy.context.tool_settings.weight_paint.brush is not None
    check(not has_brush or any(vertex.groups for vertex in sheet.data.vertices), "the mouse has painted nothing")
    yield from assign_in_the_north(sheet)
    yield from away()
    yield from screenshot("paint_mask")
    with in_region("WINDOW"):
        used = bpy.ops.icymoon.use_painted_mask("INVOKE_DEFAULT", True, kind="ROCKS")
    check(used == {"RUNNING_MODAL"}, "the mask was refused")
    yield from until(lambda: settings().rocks.mask_file and session().building is None, "Using the mask")
    low = min(vertex.co.y for vertex in next(i for i in bpy.data.objects if i.get("icymoon") == "rock").data.vertices)
    check(rocks() > 10 and low > -0.5, f"of {before} rocks {rocks()} are there, from {low} m north")
    yield from away()
    yield from screenshot("painted_rocks")
    check(bpy.context.mode == "OBJECT", f"the mode is {bpy.context.mode}")
    yield from key("ctrl+z")
    yield from until(lambda: not settings().rocks.mask_file, "Undoing the mask")
    yield from key("ctrl+z")
    yield 10 * TICK_S
    return "painted by mouse" if has_brush else "this Blender has no brushes; weights were assigned in Edit Mode"


def assign_in_the_north(sheet: bpy.types.Object) -> Waiting:
    """Give vertices of a mask their weight without a brush, as Assign does in Edit Mode."""
    with in_region("WINDOW"):
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="DESELECT")
        bpy.ops.object.mode_set(mode="OBJECT")
    sheet.data.vertices.foreach_set("select", np.arange(len(sheet.data.vertices)) < len(sheet.data.vertices) // 2)
    with in_region("WINDOW"):
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.object.vertex_group_assign()
        bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
    yield 5 * TICK_S


def camera_by_click() -> Waiting:
    """The camera goes where the ground is clicked, Esc leaves it, and Ctrl Z takes it back."""

    def place() -> tuple[float, float]:
        return settings().rig.x_m, settings().rig.y_m

    before = place()
    yield from click_header("rig")
    yield from away()
    yield from screenshot("camera_panel_alone")
    yield from press("icymoon.place_on_ground", target="CAMERA")
    yield from away()
    yield from key("Escape")
    yield 5 * TICK_S
    check(place() == before, "Esc has moved the camera")
    yield from press("icymoon.place_on_ground", target="CAMERA")
    x, y = middle("WINDOW")
    yield from to(x - 60, y - 80)
    wanted = module("operators.place_on_ground").find_ground(bpy.context, *map(int, person.seen()))
    check(wanted is not None, "there is no ground under the mouse")
    yield from screenshot("place_camera")
    xdotool("click", 1)
    yield from until(lambda: place() != before, "Placing the camera")
    off = max(abs(place()[0] - wanted.x), abs(place()[1] - wanted.y))
    check(off < 0.05, f"the camera is {off:.3f} m off the click")
    yield 10 * TICK_S
    yield from screenshot("placed_camera")
    yield from key("ctrl+z")
    yield from until(partial(holds, before, place), "Undoing the placing")
    yield from click_header("rig")
    yield from click_first_header()


def open_all_panels() -> Waiting:
    """Drag up over the closed headers, which opens them all, and look at them from top to bottom."""
    if "open_ground_panel" in {record["step"] for record in steps}:
        yield from click_header("terrain")  # which closes it
    panels = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("ICYMOON_PT_")]
    topics = sum(not hasattr(panel, "bl_parent_id") for panel in panels) - 1  # without the main panel
    yield from to_top_of_sidebar()
    yield from scroll(-400)
    headers = (yield from person.find_headers())[1:]
    if len(headers) < topics:  # the first panel is open, unless it had to be closed to reach the ground's
        yield from click_first_header()
        headers = (yield from person.find_headers())[1:]
    check(len(headers) == topics, f"{len(headers)} headers of {topics} panels are below the first panel")
    yield from person.drag_over(headers)
    fields = 0
    for k in range(2, 8):
        yield from to(headers[0][0], headers[0][1] - 24 * k)
        fields += person.over_setting("", of="terrain")
    yield from screenshot("panels_0")
    check(fields, "dragging over the headers left the topmost panel closed")
    yield from open_first_panel()
    for part in range(1, 20):
        yield from away()
        yield from screenshot(f"panels_{part}")
        yield from to(*middle("UI"))
        if not (yield from scroll(18)):
            break
    check(part > 2, f"all panels take {part} pages only")
    yield from scroll(-400)


def open_ground_panel() -> Waiting:
    """Open the panel with the settings of the ground."""
    yield from click_header("terrain")


def click_header(topic: str) -> Waiting:
    """Open the closed panel of a topic while all but the first are closed, or close it. Where the first panel leaves no
    room for its header, the first panel is closed before."""
    page = module("operators.manual").find_page_of_topic(topic)
    yield from to_top_of_sidebar()
    yield from scroll(-400)
    headers = yield from person.find_headers(most=1, page=page)
    if not headers:
        yield from click_first_header()
        headers = yield from person.find_headers(most=1, page=page)
    yield from to(*headers[0])
    xdotool("click", 1)
    yield 5 * TICK_S


def click_first_header() -> Waiting:
    """Open or close the first panel."""
    yield from to_top_of_sidebar()
    yield from scroll(-400)
    yield from to(*(yield from person.find_headers(most=1))[0])
    xdotool("click", 1)
    yield 10 * TICK_S


def open_first_panel() -> Waiting:
    """Open the first panel if it is closed: the next header is then right below its own."""
    yield from to_top_of_sidebar()
    yield from scroll(-400)
    headers = yield from person.find_headers(most=2)
    if len(headers) == 2 and headers[0][1] - headers[1][1] < 2 * person.BUTTON_PX:
        yield from click_first_header()


def to_top_of_sidebar() -> Waiting:
    """Over the first panel: below closed panels the sidebar is empty, and the wheel there zooms the view behind it."""
    sidebar = region("UI")
    yield from to(sidebar.x + sidebar.width / 2, sidebar.y + sidebar.height - 1.5 * person.BUTTON_PX)


CAMCHAIN = """cam0:
  camera_model: pinhole
  distortion_model: equidistant
  distortion_coeffs: [0.02, -0.005, 0.001, -0.0002]
  intrinsics: [160.0, 161.5, 120.25, 89.5]
  resolution: [240, 180]
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.375]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_model: equidistant
  distortion_coeffs: [0.018, -0.004, 0.001, -0.0001]
  intrinsics: [162.0, 163.5, 121.25, 90.5]
  resolution: [240, 180]
"""


def are_files(paths: list[Path]) -> bool:
    """Whether all of these are there."""
    return all(map(Path.is_file, paths))


def calibration_by_mouse() -> Waiting:
    """A file that is no calibration is refused by a sentence on the screen. One is read and fields change, undo
    restores them; what is written and read again is the same."""
    (FOLDER / "camchain.yaml").write_text(CAMCHAIN)
    (FOLDER / "broken.yaml").write_text(CAMCHAIN.replace("160.0", "none"))
    take_a_step()

    def rig() -> object:
        read = module("settings.blender.scene_properties").read_settings(settings())
        return read.rig, read.left_eye, read.right_eye

    before = rig()
    yield from click_header("rig")
    yield from away()
    yield from screenshot("camera_panel")
    yield from press("icymoon.read_calibration")
    yield from choose_in_browser(FOLDER, "broken.yaml", "calibration_broken")
    yield 15 * TICK_S  # the sentence opens under the mouse
    yield from screenshot("calibration_refused")
    yield from key("Escape")  # in 5.2 the sentence lies over the button until then
    check(rig() == before, "a file that is no calibration has changed the rig")
    yield from away()
    yield from press("icymoon.read_calibration")
    yield from choose_in_browser(FOLDER, "camchain.yaml", "calibration_read")
    yield from until(lambda: settings().rig.eyes == "CALIBRATED", "Reading the calibration")
    fields = settings().rig.baseline_m, settings().left_eye.fx_px, settings().right_eye.fy_px, settings().left_eye.lens
    close = max(abs(a - b) for a, b in zip(fields, (0.375, 160.0, 163.5), strict=False))
    check(close < 1e-4 and fields[3] == "FISHEYE", f"the fields are {fields}")
    read = rig()
    yield from away()
    yield from screenshot("calibration_fields")
    for kind, names in (("ros", ("ros_left.yaml", "ros_right.yaml")), ("opencv", ("opencv.yaml",))):
        yield from press("icymoon.write_calibration")
        yield from choose_in_browser(FOLDER, kind, f"calibration_write_{kind}", kind=kind)
        yield from until(partial(are_files, [FOLDER / name for name in names]), f"Writing {names}")
    yield from press("icymoon.write_calibration")
    yield from choose_in_browser(FOLDER, "mrcal", "calibration_write_mrcal", kind="mrcal")
    yield 15 * TICK_S  # the sentence opens under the mouse
    yield from screenshot("calibration_not_held")
    yield from key("Escape")
    check(not list(FOLDER.glob("mrcal*")), "a fisheye was written as mrcal, which has none like it")
    yield from away()
    yield from key("ctrl+z")
    yield from until(partial(holds, before, rig), "Undoing the calibration")
    yield from press("icymoon.read_calibration")
    yield from choose_in_browser(FOLDER, "opencv.yaml", "calibration_again")
    yield from until(lambda: settings().rig.eyes == "CALIBRATED", "Reading what was written")
    check(rig() == read, "what is written and read again differs")
    yield from away()
    yield from key("ctrl+z")
    yield from until(partial(holds, before, rig), "Undoing the calibration that was written")
    yield from click_header("rig")


HEAD = """[[camera]]
name = "front"
role = "hazcam"
model = "FISHEYE"
width_px = 160
height_px = 120
field_deg = 150.0
frame = "GROUND"
position_m = [0.0, 0.4, 0.6]
forward = [0.0, 1.0, -0.5]

[[camera]]
name = "map"
model = "ORTHOGRAPHIC"
width_px = 128
height_px = 128
width_m = 4.0
frame = "GROUND"
position_m = [0.0, 2.0, 5.0]
forward = [0.0, 0.0, -1.0]
up = [0.0, 1.0, 0.0]

[[camera]]
name = "side"
model = "PINHOLE"
width_px = 160
height_px = 120
field_deg = 60.0
position_m = [0.5, 0.0, 0.0]
"""


def cameras_beside_the_pair() -> Waiting:
    """A file of cameras is chosen and built: they are objects of the scene, and Ctrl Numpad 0 looks through one."""
    path = FOLDER / "head.toml"
    path.write_text(HEAD)
    settings().rig.head_file = str(path)
    yield from to(*middle("UI"))
    yield from scroll(-400)
    yield from press("icymoon.build_scene")
    names = [f"Icy Moon {name}" for name in ("front", "map", "side")]
    yield from until(lambda: all(name in bpy.data.objects for name in names), "Building the cameras")
    yield from until(lambda: not previewing(), "Building the ground")
    area().spaces.active.shading.type = "SOLID"
    for name in names:
        yield from look_through(bpy.data.objects[name])
        yield from screenshot(f"head_{name.split()[-1]}")


def look_through(item: bpy.types.Object) -> Waiting:
    """Select a camera and press Ctrl Numpad 0."""
    check(item.visible_get(view_layer=window().view_layer), f"{item.name} is not visible")
    for other in window().scene.objects:
        other.select_set(other == item)
    window().view_layer.objects.active = item
    yield from away()
    yield from key("ctrl+KP_0")
    space = area().spaces.active
    yield from until(
        lambda: item in (space.camera, window().scene.camera) and space.region_3d.view_perspective == "CAMERA",
        f"Looking through {item.name}",
    )
    yield 10 * TICK_S  # the view glides there


def build_by_mouse() -> Waiting:
    yield from press("icymoon.build_scene")
    yield from until(built, "Build Scene")
    yield from until(lambda: not previewing(), "Building the ground")
    yield from away()
    yield 30 * TICK_S  # for light paths in the picture
    yield from screenshot("built")
    # Without a graphics card every redraw of the lit view takes seconds; what follows is about the sidebar.
    area().spaces.active.shading.type = "SOLID"


def undo_and_redo() -> Waiting:
    """Undo takes the scene away and gives the view back; redo shows the scene again."""
    before, space = len(bpy.data.objects), area().spaces.active

    def view() -> tuple[str, bool, bool]:
        return space.region_3d.view_perspective, space.overlay.show_overlays, space.local_view is not None

    yield from away()
    yield from key("ctrl+z")
    yield from until(lambda: not built(), "Undoing Build Scene")
    yield from until(partial(holds, ("PERSP", True, False), view), "Giving the view back")
    yield from key("ctrl+shift+z")
    yield from until(lambda: built() and len(bpy.data.objects) == before, "Bringing the scene back by redo")
    yield from until(partial(holds, ("CAMERA", False, True), view), "Showing it again")
    space.shading.type = "SOLID"


def slide_by_mouse() -> Waiting:
    """Drag the ruggedness, type another, undo both: the ground follows every time. Leaves a preview."""
    live, scene, spans, work = module("operators.live_preview"), window().scene, [], []
    update = live.update_scene

    def timed(scene: bpy.types.Scene) -> bool:
        began, worked = time.monotonic(), time.thread_time()
        looks_otherwise = update(scene)
        spans.append((began, time.monotonic()))
        work.append(time.thread_time() - worked)
        return looks_otherwise

    bpy.context.preferences.inputs.use_mouse_continuous = False  # or Blender and xdotool both move the mouse
    x, y = yield from find_setting("terrain.rms_slope_deg")
    before, value = heights(), scene.icymoon.terrain.rms_slope_deg
    live.update_scene = timed
    xdotool("mousedown", 1)
    yield 2 * TICK_S
    for k in range(30):
        had = len(spans)
        point(x + 3 * k, y)
        for _ in range(10):  # a step may be too short to change the value
            yield 0.02
            if len(spans) > had:
                break
    check(previewing() and heights() != before, "the ground waits for the end of the drag")
    xdotool("mouseup", 1)
    yield from until(shown, "Showing what the slider says")
    check(scene.icymoon.terrain.rms_slope_deg > value, f"dragging made {value} {scene.icymoon.terrain.rms_slope_deg}")
    check(len(spans) > 10, f"there were {len(spans)} updates in 30 steps of the mouse")
    rate, took = (len(spans) - 1) / (spans[-1][1] - spans[0][1]), sum(end - begin for begin, end in spans) / len(spans)
    worked = sum(work) / len(work)
    live.update_scene = update
    dragged = heights()
    yield from screenshot("live_dragged")
    x, y = yield from find_setting("terrain.rms_slope_deg")  # the note on coarse ground takes another line
    yield from to(region("UI").x + region("UI").width / 2, y)
    xdotool("click", "--repeat", 2, "--delay", 60, 1)
    yield 6 * TICK_S
    yield from key("ctrl+a")
    yield from write_text("35")
    yield from key("Return")
    yield from until(lambda: scene.icymoon.terrain.rms_slope_deg == 35.0 and shown(), "Showing what was typed")
    check(heights() != dragged, "the ground is not what was typed")
    yield from away()
    for expected, state in ((dragged, True), (before, False)):
        yield from key("ctrl+z")
        yield from until(partial(holds, expected, heights), "Bringing the ground back by undo")
        check(previewing() == state and shown(), "undo left settings that are not the ground's")
    check(settings().terrain.rms_slope_deg == value, "undo left another value")
    yield from key("ctrl+shift+z")
    yield from until(lambda: heights() == dragged, "Bringing the preview back by redo")
    check(previewing() and shown(), "redo left settings that are not the ground's")
    # Something that an operator sets, so that there are many changes at once.
    with in_region("WINDOW"):
        bpy.ops.icymoon.load_preset("INVOKE_DEFAULT", preset="terrains/penitentes")
    yield from until(shown, "Showing the preset's ground")
    area().spaces.active.shading.type = "RENDERED"
    yield 40 * TICK_S  # for light paths in the picture
    yield from screenshot("live_preset")
    area().spaces.active.shading.type = "SOLID"
    yield from to(*middle("UI"))
    yield from scroll(-400)
    return (
        f"{len(spans)} updates, {rate:.1f} a second with redraws, {took * 1e3:.0f} ms each, "
        f"{worked * 1e3:.0f} of them work"
    )


def render_by_mouse() -> Waiting:
    """Render; the window must go on meanwhile and the sidebar must show how far it is. The fine ground follows."""
    check(previewing(), "there is no preview that could be rendered by mistake")
    settings().quality.samples = SAMPLES
    yield from press("icymoon.render_pair")
    yield from until(lambda: session().job, "Starting the render")
    check(area().spaces.active.region_3d.view_perspective == "CAMERA", "building it anew has moved the view")
    yield from away()
    start, began, fractions, drawing = len(ticks), time.monotonic(), set(), 0.0
    while job := session().job:
        if job.fraction > 0.02 and not drawing:
            yield from screenshot("rendering")
            drawing = person.drawing_s()  # while the render has the processor, as it had and will have
        fractions.add(job.fraction)
        yield TICK_S
    check(drawing, "the render ended without progress")
    duration = time.monotonic() - began
    # Drawing is Blender's own, and slow without a graphics card: one turn of the event loop draws the window once.
    # A window that waits for its render would be blocked for all of it.
    bound = min(3.0 * drawing + duration / 10, duration / 2)
    gap = max(b[0] - a[1] for a, b in zip(ticks[start:], ticks[start + 1 :], strict=False))
    check(gap < bound, f"the window was blocked for {gap:.1f} of {duration:.1f} s, where drawing takes {drawing:.1f} s")
    yield from until(lambda: not previewing(), "Making the fine ground")
    check(len(pairs()) == 1, f"{len(pairs())} pairs are there")
    check(len(fractions) > 2, f"progress was {sorted(fractions)}")
    return f"longest gap {gap:.2f} of {duration:.0f} s (bound {bound:.1f}), {len(fractions)} stages of progress"


def cell_means(image: npt.NDArray[Any], low: npt.NDArray[Any], high: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Mean colours (12, 24, 3) of the cells of an image between two corners, columns and rows."""
    columns, rows = (np.rint(np.linspace(low[k], high[k], n + 1)).astype(int) for k, n in enumerate((24, 12)))
    return np.array(
        [
            [image[top:bottom, left:right].mean(axis=(0, 1)) for left, right in pairwise(columns)]
            for top, bottom in pairwise(rows)
        ]
    )


def read_screenshot(name: str) -> npt.NDArray[Any]:
    """The colours (H, W, 3) of the last screenshot of this name, from below, as Blender's places are."""
    shot = bpy.data.images.load(str(max(FOLDER.glob(f"*_{name}.png"))))
    screen = np.empty(len(shot.pixels), np.float32)
    shot.pixels.foreach_get(screen)
    screen = screen.reshape(shot.size[1], shot.size[0], -1)[..., :3]
    bpy.data.images.remove(shot)
    return screen


def on_screen(picture: npt.NDArray[Any], name: str) -> Waiting:
    """How much what the second window shows of the image differs from a picture (H, W, 3), from 0 to 1."""
    yield from screenshot(name)
    screen = read_screenshot(name)
    other = manager().windows[1]
    canvas = next(r for r in other.screen.areas[0].regions if r.type == "WINDOW")
    corners = np.array([canvas.view2d.view_to_region(k, k, clip=False) for k in (0.0, 1.0)], float)
    corners += (other.x + canvas.x, other.y + canvas.y)
    seen = cell_means(screen, *corners)
    drawn = cell_means(picture[::-1] / 255.0, np.zeros(2), np.array(picture.shape[1::-1]))
    check(seen.std() > 0.02, "the window shows one colour only")
    return float(np.abs(seen - drawn).mean())


def is_other_file(path: str) -> bool:
    """Whether the image of the pair shows another file than this one."""
    return bool(module("operators.show_pair").find_image().filepath_raw != path)


def pair_on_the_screen() -> Waiting:
    """The render has ended with its pair on the screen; each view that is chosen is what is seen."""
    show = module("operators.show_pair")
    yield from until(lambda: session().shown and len(manager().windows) == 2, "Showing the pair")
    yield 10 * TICK_S
    views = session().shown.views
    differences: list[str] = []
    check(area().type == "VIEW_3D", "the 3D View was taken")
    for view in ("SIDE_BY_SIDE", "DEPTH", "LEFT", "ANAGLYPH", "FLICKER", "SIDE_BY_SIDE"):
        with in_region("UI"):  # not by mouse: the window of the picture may cover the buttons
            bpy.ops.icymoon.show_pair("INVOKE_DEFAULT", view=view)
        yield from until(partial(holds, view, lambda: session().shown.view), f"Showing {view}")
        if view == "FLICKER":
            path = show.find_image().filepath_raw
            yield from until(partial(is_other_file, path), "Flickering")
            with in_region("WINDOW"):
                bpy.ops.ed.undo()
                bpy.ops.ed.redo()
            continue
        apart = yield from on_screen(views.pictures(view)[0], f"pair_{view.lower()}_{len(differences)}")
        check(apart < 0.03, f"what is seen differs from {view} by {apart:.3f} on average")
        differences.append(f"{view} {apart:.3f}")
    check(not show.find_image().is_dirty, "the image counts as changed by hand")
    yield from undo_before_the_pair()
    yield from person.close_second_window("the Image Editor")
    yield from until(lambda: not bpy.app.timers.is_registered(show._show_other_eye), "The end of the flicker")
    yield from screenshot("pair_in_the_sidebar")
    return ", ".join(differences)


def undo_before_the_pair() -> Waiting:
    """Undo to before the pair was shown, and redo: the pair stays in its window."""
    show, editor = module("operators.show_pair"), manager().windows[1].screen.areas[0]
    with in_region("WINDOW"):
        bpy.ops.ed.undo_push(message="Before")
        for _ in range(4):
            bpy.ops.ed.undo()
    yield from until(lambda: editor.spaces.active.image is not None, "The pair after undo")
    yield 5 * TICK_S
    yield from screenshot("pair_after_undo")
    check(editor.spaces.active.image == show.find_image(), "the window shows another image after undo")
    with in_region("WINDOW"):
        for _ in range(4):
            bpy.ops.ed.redo()
    yield from until(lambda: editor.spaces.active.image == show.find_image() is not None, "The pair after redo")


def escape_twice() -> Waiting:
    """Stop the running job, as quickly as a person presses a key twice: Blender takes that for a double click."""
    xdotool("key", "--delay", 80, "Escape", "Escape")
    yield TICK_S


def escape_a_render() -> Waiting:
    """One Esc does not stop a render, two do."""
    settings().quality.samples = 60000
    yield from press("icymoon.render_pair")
    yield from until(lambda: session().job and session().job.fraction > 0, "Progress")
    yield from until(lambda: list(DATASET.glob("pairs/*.part")), "Writing")
    x, y = middle("UI")
    yield from to(x, y)
    yield from key("Escape")  # which is pressed for other reasons too
    yield 10 * TICK_S
    check(not session().job.process.cancelled, "one Esc has stopped the render")
    yield from screenshot("escaped_once")
    yield 20 * TICK_S
    yield from key("Escape")
    yield 10 * TICK_S
    check(not session().job.process.cancelled, "Esc has stopped the render long after the first one")
    yield 20 * TICK_S
    yield from escape_twice()
    yield from ended()
    yield from until(lambda: not list(DATASET.glob("pairs/*.part")), "Removing what was half written")
    check(len(pairs()) == 1, "the first pair is gone")
    yield from screenshot("cancelled")
    settings().quality.samples = SAMPLES


def evaluate_by_mouse() -> Waiting:
    yield from press("icymoon.evaluate")
    yield from until(lambda: session().job, "Starting the evaluation")
    yield from ended()
    yield from away()
    check((DATASET / "evaluation_scene" / "report.html").is_file(), "there is no report")
    yield 20 * TICK_S  # the panels slide into place
    yield from screenshot("evaluated")


def measured_surface() -> Waiting:
    """What a matcher measured appears beside the true ground, also within the view of our objects only, and goes."""

    def there() -> list[bpy.types.Object]:
        return [item for item in bpy.data.objects if item.get("icymoon") == "measured surface"]

    yield from press("icymoon.show_surface", method="sgbm")
    yield from until(there, "Showing the measured surface")
    yield from until(lambda: there()[0].visible_get(viewport=area().spaces.active), "Taking it into this view")
    yield from away()
    yield from screenshot("measured_surface")
    yield from press("icymoon.hide_surface")
    yield from until(lambda: not there(), "Removing the measured surface")


def lidar_by_f3() -> Waiting:
    """Beams and points of a LiDAR, by F3, appear beside the ground, follow the slider, and go by undo and by F3."""
    view, scene = module("nodes.lidar_in_view"), bpy.context.scene

    def count() -> int:
        item = view.find_points(bpy.context.scene)
        return len(item.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons) if item else 0

    settings().lidar.columns = 128
    yield from away()
    yield from by_f3("Show LiDAR Beams")
    yield from until(lambda: view.find_shown(scene), "Showing the beams")
    before = area().spaces.active.region_3d.view_perspective
    looking = area().spaces.active.region_3d
    looking.view_perspective, looking.view_location, looking.view_distance = "PERSP", (0.0, 0.0, 1.6), 12.0
    yield 10 * TICK_S
    yield from screenshot("lidar_beams")
    looking.view_perspective = before
    yield from by_f3("Scan with LiDAR")
    yield from until(lambda: session().job, "Starting the scan")
    yield from screenshot("lidar_scanning")
    yield from until(count, "Showing the points")
    yield 10 * TICK_S
    yield from screenshot("lidar_points")
    settings().lidar.points = 50
    yield from until(lambda: count() == 50, "Following the slider")
    settings().lidar.points, settings().lidar.colour = 10000, "ICE_DELAY"
    yield from key("ctrl+z")
    yield from until(lambda: not count(), "Undoing the points")
    yield from key("ctrl+shift+z")
    yield from until(count, "Bringing the points back")
    yield from by_f3("Remove LiDAR Points")
    yield from until(lambda: view.find_shown(bpy.context.scene) is None, "Removing the points")


def painted_errors() -> Waiting:
    """Errors appear on the ground in Solid shading, follow their range, and go with what the view showed before."""
    painted, shading = module("nodes.painted_errors"), area().spaces.active.shading

    def view() -> tuple[str, str]:
        return shading.type, shading.color_type

    def coloured() -> float:
        """The mean distance of the ground's colours from grey."""
        colours = bpy.data.objects["Icy Moon Terrain"].data.attributes[painted.COLOUR].data
        values = np.empty(4 * len(colours), np.float32)
        colours.foreach_get("color_srgb", values)
        return float(np.ptp(values.reshape(-1, 4)[:, :3], axis=1).mean())

    before = view()
    yield from press("icymoon.paint_errors", method="sgbm")
    yield from until(lambda: painted.find_painted(window().scene), "Painting the errors")
    yield from away()
    yield from screenshot("painted_errors")
    check(view() == ("SOLID", "VERTEX"), f"the view shows {view()}")
    for keys, expected in (("ctrl+z", before), ("ctrl+shift+z", ("SOLID", "VERTEX"))):
        yield from key(keys)
        yield from until(partial(holds, expected, view), f"{keys} after painting the errors")
    amount = coloured()
    yield from find_setting("error_range_m")
    xdotool("click", "--repeat", 2, "--delay", 60, 1)
    yield 6 * TICK_S
    yield from key("ctrl+a")
    yield from write_text("0.05")
    yield from key("Return")
    yield from until(lambda: coloured() > 1.1 * amount, "Recolouring the ground")
    yield from away()
    yield from screenshot("painted_errors_range")
    yield from press("icymoon.hide_surface")
    yield from until(lambda: not painted.find_painted(window().scene), "Removing the errors")
    check(view() == before, f"the view shows {view()}, and before {before}")
    check(not module("nodes.build_scene").find_built(window().scene).edited, "painting counts as an edit by hand")
    settings().error_range_m = 1.0


THEMES = ("Blender_Light.xml", "Blender_Dark.xml")
#: WCAG's least contrast of text.
MIN_CONTRAST = 4.5


def metrics_can_be_read() -> Waiting:
    """The metrics stand out from their background in both themes, measured on screenshots."""
    noted = []
    for theme in THEMES:
        folders = bpy.utils.preset_paths("interface_theme")
        path = next(found for folder in folders if (found := Path(folder, theme)).is_file())
        with in_region("WINDOW"):
            bpy.ops.script.execute_preset(filepath=str(path), menu_idname="USERPREF_MT_interface_theme_presets")
        yield 10 * TICK_S
        _, y = yield from find("icymoon.show_error", method="sgbm")
        yield from away()
        yield from screenshot(f"metrics_{Path(theme).stem}")
        picture = np.rint(255 * read_screenshot(f"metrics_{Path(theme).stem}")).astype(np.uint8)
        sidebar, row = region("UI"), person.BUTTON_PX
        lowest = int(y + 0.8 * row)  # of the rows of metrics, which are above the button
        left, right = sidebar.x + 14, sidebar.x + sidebar.width - 40
        words = measure_words(picture[lowest : lowest + int(5.5 * row), left:right][::-1])
        check(len(words) >= 8, f"{len(words)} words are found in the metrics")
        least = min(word.ratio for word in words)
        check(least >= MIN_CONTRAST, f"{theme}: a metric has a contrast of {least:.2f}")
        noted.append(f"{Path(theme).stem} {least:.1f}")
    return "least contrast " + ", ".join(noted)


def show_error() -> Waiting:
    yield from press("icymoon.show_error", method="sgbm")
    yield from until(lambda: len(manager().windows) == 2, "Opening an Image Editor")
    space = manager().windows[1].screen.areas[0].spaces.active
    check(space.type == "IMAGE_EDITOR" and space.image and space.image.size[0] > 0, "it shows no image")
    yield 10 * TICK_S
    yield from screenshot("error_image")
    yield from person.close_second_window("the Image Editor")


def camera_image_follows() -> Waiting:
    """The camera image that is shown is exposed again when the response changes, and the window goes on meanwhile."""
    settings().sensor.pixel_pitch_um = 5.0  # of so few columns over the rig, no shutter is fast enough
    with in_region("UI"):
        bpy.ops.icymoon.expose("INVOKE_DEFAULT")
    yield from ended()
    yield from until(lambda: len(manager().windows) == 2, "Opening an Image Editor")
    follow, image = module("operators.live_exposure"), manager().windows[1].screen.areas[0].spaces.active.image
    yield from until(lambda: not bpy.app.timers.is_registered(follow.develop_waiting), "Following the new pixel pitch")
    yield from screenshot("camera_image")
    before, work, spans = sum(image.pixels[:][::4]), follow.develop_waiting, []

    def timed() -> float | None:
        start = time.thread_time()
        again = work()
        spans.append(time.thread_time() - start)
        return again

    follow.develop_waiting = timed
    began = time.monotonic()
    for target in (0.6, 0.4, 0.2, 0.1):
        settings().sensor.auto_target = target
        yield TICK_S
    yield from until(lambda: session().developing is not None, "Starting to follow")
    yield from until(lambda: session().developing is None and not session().to_develop, "Following")
    lasted = time.monotonic() - began
    follow.develop_waiting = work
    check(sum(image.pixels[:][::4]) < 0.5 * before, "the image did not follow the exposure")
    check(not follow.list_lines(), " ".join(follow.list_lines()))
    check(max(spans) < lasted / 10, f"following kept the window busy for {max(spans):.2f} of {lasted:.1f} s at once")
    yield from screenshot("camera_image_followed")
    yield from person.close_second_window("the Image Editor")
    for key_of_response in ("pixel_pitch_um", "auto_target"):
        settings().sensor.property_unset(key_of_response)
    return f"longest turn {1000 * max(spans):.0f} ms of {lasted:.1f} s"


def preferences_page() -> Waiting:
    """The extension's page in the preferences, the evaluator given there instead of by the environment."""
    add_on = bpy.context.preferences.addons[ADD_ON]
    add_on.preferences.evaluator = os.environ.pop("ICYMOON_EVALUATOR", "")
    yield from person.open_preferences()
    yield from screenshot("preferences")
    yield from person.close_second_window("the preferences")


def search_and_clear() -> Waiting:
    """F3, type, Return: Clear Scene."""
    yield from away()
    yield from key(F3)
    yield 20 * TICK_S  # the first search goes through all menus
    yield from write_text("clear scene")
    yield from screenshot("search")
    yield from key("Return")
    yield from until(lambda: not built(), "Clear Scene by F3")
    yield from screenshot("cleared")


def by_f3(words: str) -> Waiting:
    """F3, words, Return; the mouse is not touched."""
    yield from key(F3)
    yield 20 * TICK_S  # the first search goes through all menus
    yield from write_text(words)
    yield 3 * TICK_S
    yield from key("Return")
    yield 3 * TICK_S


def first_minute_by_keys() -> Waiting:
    """From an empty scene to a measured pair by the keyboard alone."""
    yield from away()
    folder = FOLDER / "keys"
    yield from by_f3("load preset")
    yield from write_text("europa rough ice")
    yield 5 * TICK_S
    yield from screenshot("keys_preset")
    yield from key("Return")
    yield from until(lambda: settings().preset == "scenes/europa_rough_ice", "Loading a preset by keys")
    settings().rig.width_px, settings().rig.height_px = 240, 180
    settings().mesh.error_px, settings().mesh.edge_px = 4.0, 24.0
    settings().quality.samples, settings().dataset.folder = 4, str(folder)
    yield from by_f3("build scene")
    yield from until(built, "Building by keys")
    yield from by_f3("render stereo pair")
    yield from until(lambda: len(manager().windows) == 2, "Rendering by keys")
    yield from person.close_second_window("the Image Editor")
    yield from ended()
    yield from away()  # which gives the window its keyboard back: there is no window manager
    yield from by_f3("evaluate stereo pair")
    yield from until(lambda: session().job, "Starting the evaluation by keys")
    yield from ended()
    check((folder / "evaluation_scene" / "report.html").is_file(), "there is no report")
    yield from screenshot("keys_evaluated")
    if len(manager().windows) == 2:  # of the error image
        yield from person.close_second_window("the Image Editor")


def drag_an_asset() -> Waiting:
    """A library of one asset is made, and its surface is dragged from the Asset Browser onto a cube."""
    operator = module("operators.make_asset_library")
    whole = operator.blender_command
    operator.blender_command = lambda *words: whole(*words, "surfaces/rough_ice")
    with in_region("WINDOW"):
        bpy.ops.icymoon.make_asset_library("INVOKE_DEFAULT")
    yield from ended()
    operator.blender_command = whole
    check(
        [each.name for each in bpy.context.preferences.filepaths.asset_libraries].count("Icy Moon") == 1,
        "the asset library is not listed once",
    )
    with in_region("WINDOW"):
        bpy.ops.screen.area_split(direction="HORIZONTAL", factor=0.5)
    browser = min((each for each in window().screen.areas if each.type == "VIEW_3D"), key=lambda each: each.y)
    browser.ui_type = "ASSETS"
    yield 10 * TICK_S  # until it has its parameters
    browser.spaces.active.params.asset_library_reference = "Icy Moon"
    cube = bpy.data.objects.new("Asset Test", bpy.data.meshes["Cube"].copy())
    window().scene.collection.objects.link(cube)
    if area().spaces.active.local_view is not None:
        cube.local_view_set(area().spaces.active, True)
    near = Matrix.Translation((0, 0, -0.6)) @ Matrix.Scale(0.08, 4)  # before all ground
    cube.matrix_world = area().spaces.active.region_3d.view_matrix.inverted() @ near
    list_of_assets = next(each for each in browser.regions if each.type == "WINDOW")
    yield 20 * TICK_S  # it reads the library in the background
    yield from screenshot("asset_browser")
    place = list_of_assets.x + 70, list_of_assets.y + list_of_assets.height - 60
    yield from to(*place)
    xdotool("mousedown", 1)
    for share in (0.05, 0.1, 0.4, 0.7, 1.0):  # it is a drag only after some pixels
        point(*(a + share * (b - a) for a, b in zip(place, middle("WINDOW"), strict=True)))
        yield 2 * TICK_S
    xdotool("mouseup", 1)
    yield from until(lambda: cube.data.materials and cube.data.materials[0].name == "Rough ice", "Dropping a surface")
    yield from screenshot("asset_dropped")
    check(bpy.ops.icymoon.remove_asset_library() == {"FINISHED"}, "the asset library is not removed")
    check(not module("operators.preferences").find_asset_libraries(), "the removed asset library is listed")
    bpy.data.objects.remove(cube)
    with bpy.context.temp_override(window=window(), area=browser):
        bpy.ops.screen.area_close()
    yield 5 * TICK_S


def take_a_step() -> None:
    """Have undo come back to here: what this script sets by itself is no step."""
    with in_region("WINDOW"):
        bpy.ops.ed.undo_push(message="Test")


def choose_by_picture() -> Waiting:
    """A scene chosen by its picture is shown at once. Ctrl Z takes it back wherever the mouse is, redo brings it."""
    take_a_step()

    def now() -> tuple[object, bool]:
        return module("settings.blender.scene_properties").read_settings(settings()), built()

    before = now()
    for where in ("where the picture was clicked", "in the view"):
        x, y = yield from person.over_the_pictures()
        xdotool("click", 1)
        yield 15 * TICK_S  # the pictures open
        yield from screenshot("scene_pictures")
        point(x - 400, y - 180)  # some scene of the first row
        yield 5 * TICK_S
        xdotool("click", 1)
        yield from until(lambda: now() != before and session().building is session().job is None, "Choosing a picture")
        chosen = now()
        check(built() and previewing(), "the chosen scene is not shown coarsely at once")
        covered = partial(session().picture.is_shown, window().scene)
        check(covered(), "no picture of the chosen scene covers the view")
        if where == "in the view":
            yield from away()
        for keys, expected in (("ctrl+z", before), ("ctrl+shift+z", chosen), ("ctrl+z", before)):
            yield from key(keys)
            yield from until(
                partial(holds, expected, now), f"{keys} after choosing a scene by its picture, the mouse {where},"
            )
            check(not covered(), f"the picture of the scene is still there after {keys}")


def undo_by_key() -> Waiting:
    """What operators do to the scene is undone by Ctrl Z, each by one."""
    operators, file = bpy.ops.icymoon, FOLDER / "some.toml"
    file.write_text("[rocks]\ncoverage = 0.125\n")
    take_a_step()

    def state() -> object:
        read = module("settings.blender.scene_properties")
        return (
            read.read_settings(settings()),
            read.read_variations(settings()),
            sorted(item.name for item in bpy.data.objects),
        )

    for operator, options in (
        (operators.add_terrain, {}),
        (operators.add_block, {}),
        (operators.layer_add, {}),
        (operators.load_settings, {"filepath": str(file)}),
        (operators.vary, {"setting": "surface.albedo"}),
        (operators.variation_remove, {}),
        (operators.choose_plan, {"plan": "datasets/guiss_snow"}),
        (operators.load_preset, {"preset": "lights/guiss_europa"}),
    ):
        before = state()
        yield from away()
        with in_region("WINDOW"):
            check(operator("EXEC_DEFAULT", True, **options) == {"FINISHED"}, f"{operator} did not do its work")
        check(state() != before, f"{operator} did nothing")
        yield 5 * TICK_S
        yield from key("ctrl+z")
        yield from until(partial(holds, before, state), f"Undoing {operator}")


def render_in_a_local_view() -> Waiting:
    """Where the view leaves a person's own objects out, a render that builds the scene anew keeps its camera too."""
    with in_region("WINDOW"):
        bpy.ops.icymoon.build_scene("INVOKE_DEFAULT", True)
    yield from ended()
    space = area().spaces.active
    space.shading.type = "SOLID"
    check(space.local_view, "the person's own objects are in the view")
    settings().terrain.hurst += 0.01
    with in_region("WINDOW"):
        bpy.ops.icymoon.render_pair("INVOKE_DEFAULT")
    yield from until(lambda: space.camera == bpy.data.objects.get("Icy Moon Camera"), "Looking through its camera")
    yield from away()
    yield from key("Escape")
    yield from ended()


def close_other_windows() -> Waiting:
    """Close all windows but the first, also one that will open for the last pair."""
    yield from until(lambda: session().reading is None and not session().to_show, "Showing the last pair")
    yield 10 * TICK_S
    for opened in list(manager().windows)[1:]:
        with bpy.context.temp_override(window=opened):
            bpy.ops.wm.window_close()


def build_a_workspace() -> Waiting:
    """The ground before a lander, small and coarse, without the lander, and no window before it."""
    yield from close_other_windows()
    with in_region("UI"):
        bpy.ops.icymoon.load_preset(preset="scenes/workspace_europa_lander")
    group = settings()
    group.rig.width_px, group.rig.height_px = 320, 240
    group.mesh.error_px, group.mesh.edge_px = 4.0, 24.0
    group.quality.samples, group.lander.kind, group.workspace.cell_m = 16, "NONE", 0.03
    group.dataset.folder, group.dataset.methods = str(FOLDER / "decided"), "bm,sgbm"
    with in_region("WINDOW"):
        bpy.ops.icymoon.build_scene("INVOKE_DEFAULT", True)
    yield from until(lambda: built() and not previewing(), "Build Scene")
    area().spaces.active.shading.type = "SOLID"
    yield from to(*middle("UI"))
    yield from scroll(-400)


def turn_an_arm() -> Waiting:
    """A lander is put into the built scene and a joint of its arm dragged: it follows at once, and undo."""
    yield from build_a_workspace()

    def scoop() -> list[tuple[float, ...]]:
        return [
            tuple(round(x, 5) for x in item.matrix_world.translation)
            for item in bpy.data.objects
            if item.get("icymoon") == "lander scoop"
        ]

    ground = heights()
    yield from person.turn_choice("lander.kind", 1)
    yield from until(scoop, "Showing the lander")
    check(settings().lander.kind == "PARAMETRIC", f"the lander is {settings().lander.kind}")
    check(heights() == ground and not previewing(), "the lander has changed the ground")
    yield from scroll(5)  # to what is in the panel of the lander
    headers = yield from person.find_headers(page="howto/lander")
    yield from person.drag_over(headers[-2:])  # Deck and Legs, and the arm
    yield from away()
    yield from screenshot("lander")
    x, y = yield from find_setting("arm.yaw_deg")
    before, places = scoop(), set()
    bpy.context.preferences.inputs.use_mouse_continuous = False  # or Blender and xdotool both move the mouse
    xdotool("mousedown", 1)
    yield 2 * TICK_S
    for k in range(20):
        point(x - 2 * k, y)
        yield TICK_S
        places.add(scoop()[0])
    check(len(places) > 5, f"the scoop was at {len(places)} places while its yaw was dragged")
    xdotool("mouseup", 1)
    yield 5 * TICK_S
    after, turned = scoop(), settings().arm.yaw_deg
    check(shown() and heights() == ground, "the arm has changed the ground")
    check(abs(turned) < 105.0, f"dragging turned the arm to {turned}°, beyond its limits")
    yield from away()
    yield from screenshot("arm_turned")
    for keys, expected in (("ctrl+z", before), ("ctrl+shift+z", after)):
        yield from key(keys)
        yield from until(partial(holds, expected, scoop), f"{keys} after turning the arm")
    check(settings().arm.yaw_deg == turned, "redo left another angle")
    yield from key("ctrl+z")  # to where the next steps have it
    return f"{len(places)} places of the scoop in 20 steps of the mouse"


def is_dug(path: str) -> bool:
    """Whether the settings and the ground have this path of the scoop."""
    return settings().excavation.path == path and shown()


def dig_a_trench() -> Waiting:
    """A trench is dug by its choice, deeper by its state, and goes by undo."""
    group = settings()
    group.excavation.cell_m, group.excavation.bite_m = 0.01, 0.1
    group.excavation.start_x_m, group.excavation.start_y_m = group.workspace.east_m, group.workspace.north_m
    take_a_step()
    yield from to(*middle("UI"))
    yield from scroll(-400)
    headers: list[person.Place] = []
    while not headers:  # it is within a panel that is longer than the sidebar
        yield from to(*middle("UI"))
        check((yield from scroll(8)), "there is no panel Excavation")
        headers = yield from person.find_headers(page="theory/excavation")
    yield from to(*headers[0])
    xdotool("click", 1)
    yield 5 * TICK_S
    yield from person.turn_choice("excavation.path", 1)
    yield from until(partial(is_dug, "LINE"), "Digging a trench")
    yield from away()
    yield from screenshot("trench")
    yield from to(*middle("UI"))
    yield from scroll(-400)
    yield from press("icymoon.build_scene")
    yield from until(lambda: not previewing() and shown(), "Building the trench")
    dug = module("nodes.build_scene").find_built(window().scene).terrain.data
    start = Vector((group.excavation.start_x_m, group.excavation.start_y_m))
    near = sum((vertex.co.xy - start).length < 0.2 for vertex in dug.vertices)
    check(near > 300, f"{near} vertices are near the trench, whose cells are 1 cm wide")
    yield from away()
    yield from screenshot("trench_built")
    for keys, path in (("ctrl+z", "LINE"), ("ctrl+z", "NONE"), ("ctrl+shift+z", "LINE")):
        yield from key(keys)
        yield from until(partial(is_dug, path), f"{keys} after digging")


def decide_by_mouse() -> Waiting:
    """Where a lander would dig is decided, and painted on the ground by each map, with its site and its reach."""
    painted, shading = module("nodes.painted_decisions"), area().spaces.active.shading
    decided = Path(settings().dataset.folder) / "decisions" / "decisions.html"
    opened: list[str] = []
    webbrowser.open, open_page = opened.append, webbrowser.open  # type: ignore[assignment]

    def legend() -> str:
        return next((text for text, _ in painted.make_legend(window().scene)), "")

    yield from press("icymoon.render_pair")
    yield from until(lambda: session().job, "Starting the render")
    yield from ended()
    yield from until(lambda: len(manager().windows) == 2, "Showing the pair")
    yield 10 * TICK_S
    yield from screenshot("lander_pair")
    yield from person.close_second_window("the Image Editor")
    yield from to(*middle("UI"))
    yield from scroll(400)
    yield from press("icymoon.decide", fuse_suns=None)
    yield from until(lambda: session().job, "Starting to decide")
    yield from ended()
    yield from until(lambda: opened, "Opening the report")
    webbrowser.open = open_page
    check(opened == [decided.as_uri()] and decided.is_file(), f"what opens is {opened}")
    before = shading.type, shading.color_type
    for method, kind in (
        ("sgbm", "SUITABILITY"),
        ("true depth", "SUITABILITY"),
        ("sgbm", "SLOPE"),
        ("sgbm", "HEIGHT_ERROR"),
    ):
        title = f"{painted.TITLES[kind]} by {'SGBM' if method == 'sgbm' else method}"
        yield from press("icymoon.paint_decisions", method=method, map=kind)
        yield from until(partial(holds, title, legend), f"Painting {kind} by {method}")
        check((shading.type, shading.color_type) == ("SOLID", "VERTEX"), f"the view shows {shading.color_type}")
        yield from away()
        yield from screenshot(name := f"decisions_{kind.lower()}_{method.replace(' ', '_')}")
        screen, view = read_screenshot(name), region("WINDOW")
        red, green, blue = (
            screen[view.y : view.y + view.height, view.x : view.x + view.width // 2 + 100].reshape(-1, 3).T
        )
        check(((blue - red > 0.3) & (green - red > 0.3)).sum() > 50, "no line of the reach is seen in cyan")
        check(method == "sgbm" or ((red - green > 0.3) & (blue - green > 0.15)).sum() > 20, "no magenta ring is seen")
        white = float((np.minimum(np.minimum(red, green), blue) > 0.85).mean())
        check(kind == "HEIGHT_ERROR" or white < 0.02, f"{white:.0%} of the view is white, as the lander must not be")
    there = {item.name for item in painted.find_painted(window().scene).objects}
    check(painted.REACH in there, f"what is shown is {there}")
    yield from key("ctrl+z")
    yield from until(lambda: legend().startswith("Slope"), "Bringing the slope back by undo")
    yield from to(*middle("UI"))
    yield from scroll(400)  # to the legend
    yield from away()
    yield from screenshot("decisions_legend")
    yield from press("icymoon.hide_decisions")
    yield from until(lambda: not legend(), "Removing the decisions")
    check((shading.type, shading.color_type) == before, f"the view shows {shading.type}, and before {before}")
    check(not module("nodes.build_scene").find_built(window().scene).edited, "painting counts as an edit by hand")


def jobs_end_in_any_case() -> Waiting:
    """A render goes on when its operator gets no more events, and ends when its operator meets a fault."""
    with in_region("WINDOW"):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    yield 5 * TICK_S
    start_watching()
    tiny = {**scene_sequences.TINY, "dataset": {"folder": str(FOLDER / "tiny"), "seed": 1}}
    module("settings.blender.scene_properties").write_settings(settings(), tiny)
    area().spaces.active.shading.type = "SOLID"
    operators, unseen = module("operators.job_operators"), module("operators.unseen_jobs")
    for kind in ("no events", "fault"):
        yield from call(bpy.ops.icymoon.render_pair, again=True)
        yield from until(lambda: session().job and children(), "Starting the render")
        watch = next(each for each in unseen._watches if each.job is session().job)
        if kind == "fault":
            watch.job.handle = {}.__getitem__
            operators.traceback = types.SimpleNamespace(print_exc=lambda: None)  # the lane fails on printed tracebacks
        else:
            manager().event_timer_remove(watch.operator._timer)
        yield from ended()
        check(watch.ended, "the job has ended without its operator")
        if kind == "fault":
            operators.traceback = traceback
        else:
            check(not watch.is_seen, "the operator got events")
            check(list((FOLDER / "tiny").glob("pairs/*/pair.json")), "the pair is not there")
            yield from close_other_windows()
        yield from to(*middle("WINDOW"))  # an event, at which the operator leaves
        left = [each.bl_idname for each in window().modal_operators]
        check("ICYMOON_OT_render_pair" not in left, f"the window still has {left}")


def scenes_files_and_undo() -> Waiting:
    """The forty sequences of ``scene_sequences``, in this window; a line for each, and none may fail.

    ICYMOON_SEQUENCES=3,17 runs some, by their numbers.
    """
    named = [int(word) for word in os.environ.get("ICYMOON_SEQUENCES", "").split(",") if word]
    wanted = named or range(1, len(scene_sequences.SEQUENCES) + 1)
    runner = scene_sequences.Runner(
        lambda name: importlib.import_module(f"{ADD_ON}.{name}"),
        FOLDER / "sequences",
        partial(in_region, "WINDOW"),
        until,
    )
    runner.folder.mkdir()
    # Without a graphics card each redraw of the view takes a second, and with smooth edges there are 8 for each change.
    bpy.context.preferences.system.viewport_aa = "OFF"
    build = module("operators.build")
    show = build.show_scene

    def show_without_light(context: bpy.types.Context, there: Any) -> None:
        """Without a graphics card every redraw of the lit view takes seconds."""
        show(context, there)
        context.space_data.shading.type = "SOLID"

    build.show_scene = show_without_light
    faults = yield from scene_sequences.run_all(runner, wanted)
    build.show_scene = show
    start_watching()
    check(not faults, f"{len(faults)} of {len(wanted)} sequences failed: {'; '.join(faults)}")
    return f"{len(wanted)} sequences"


#: Longest piece of the extension's own work by action, in seconds of the processor: about one and a half times the
#: most that a busy machine measured on the two scenes; other actions take less than 0.2 s.
LONGEST_S = {
    "preset": 0.4,
    "build": 0.4,
    "slider of the ground": 0.9,
    "slider of the Sun": 0.3,
    "slider of the surface": 0.45,
    "render": 0.5,
    "evaluate": 0.5,
    "paint errors": 2.5,
    "paint decisions": 1.4,
    "render what was edited": 0.9,
}
OTHERS_S = 0.2
#: Scenes of ``count_late_turns``, unless ICYMOON_LATE_SCENES names them; ICYMOON_LATE_ACTIONS names actions to count,
#: and leaves the others out.
LATE_SCENES = ("europa_rough_ice", "enceladus_block_field")


def act(lateness: Lateness, action: str, do: Waiting) -> Waiting:
    """Count late turns while something is done, until no job and no ground is awaited any more."""
    yield 5 * TICK_S
    lateness.count(action)
    yield from do
    yield from ended()
    yield from until(lambda: not session().painting, action)
    yield from until(lambda: not built() or not previewing() or not refining(), f"The ground after {action}")
    yield 5 * TICK_S
    lateness.count("")
    lateness.write(FOLDER / "late.json")


def refining() -> bool:
    """Whether a fine ground is being made."""
    refine = module("operators.refine_ground")
    return bool(refine.describe_refining(window().scene))


def call(operator: Any, **options: object) -> Waiting:
    """Start an operator in the 3D View as its button would. The view shows no mesh: without a graphics card drawing
    the ground takes a second and counts as Blender's."""
    area().spaces.active.show_object_viewport_mesh = False
    with in_region("WINDOW"):
        operator("INVOKE_DEFAULT", True, **options)
    area().spaces.active.shading.type = "SOLID"  # without a graphics card a lit view takes seconds to draw
    yield TICK_S


def begin_and_escape(operator: Any) -> Waiting:
    """Start a job and stop it."""
    yield from call(operator)
    yield from until(lambda: session().job, "Starting the job")
    yield 10 * TICK_S
    yield from away()
    yield from escape_twice()


def save_by_script(path: Path) -> Waiting:
    """Save a copy of the file as Blender does after a name was chosen, without the picture of it."""
    bpy.context.preferences.filepaths.file_preview_type = "NONE"
    with in_region("WINDOW"):
        bpy.ops.wm.save_as_mainfile("EXEC_DEFAULT", filepath=str(path), copy=True)
    yield TICK_S


def drag(topic: str, key_: str, values: npt.NDArray[Any]) -> Waiting:
    """Give a setting value after value, as a slider does."""
    for value in values:
        setattr(getattr(settings(), topic), key_, float(value))
        yield 0.02
    yield from until(shown, f"Showing {topic}.{key_}")


def count_late_turns() -> Waiting:
    """How long the extension holds the window for each action, on scenes with their ground in full."""
    lateness, operators, group = Lateness(), bpy.ops.icymoon, settings()
    lateness.start()
    patience, person.PATIENCE_S = person.PATIENCE_S, 900.0
    opened: list[str] = []
    webbrowser.open, open_page = opened.append, webbrowser.open  # type: ignore[assignment]
    bpy.context.preferences.view.render_display_type = "NONE"
    named = os.environ.get("ICYMOON_LATE_SCENES", "")
    wanted = [action for action in os.environ.get("ICYMOON_LATE_ACTIONS", "").split(",") if action]
    for scene in named.split(",") if named else LATE_SCENES:
        if built():
            with in_region("WINDOW"):
                operators.clear_scene("EXEC_DEFAULT")

        def under(action: str, do: Waiting, scene: str = scene) -> Waiting:
            if action in wanted or not wanted:
                yield from act(lateness, f"{scene}: {action}", do)

        group.dataset.folder, group.dataset.methods = str(FOLDER / scene), "bm"
        yield from under("preset", call(operators.load_preset, preset=f"scenes/{scene}", build=True))
        group.quality.samples = 1
        yield from until(shown, "Showing the samples")
        yield from under("slider of the ground", drag("terrain", "rms_slope_deg", np.linspace(20.0, 25.0, 12)))
        yield from under("slider of the Sun", drag("light", "sun_elevation_deg", np.linspace(20.0, 30.0, 12)))
        yield from under("slider of the surface", drag("surface", "albedo", np.linspace(0.7, 0.8, 12)))
        yield from under("build", call(operators.build_scene))
        yield from under("save", save_by_script(FOLDER / "kept.blend"))
        yield from under("render", call(operators.render_pair))
        yield from under("evaluate", call(operators.evaluate))
        yield from under("paint errors", call(operators.paint_errors, method="bm"))
        yield from under("remove errors", call(operators.hide_surface))
        yield from under("decide", call(operators.decide))
        if operators.paint_decisions.poll():
            yield from under("paint decisions", call(operators.paint_decisions, method="bm", map="SLOPE"))
            yield from under("remove decisions", call(operators.hide_decisions))
        bpy.data.objects["Icy Moon Camera"].location.z += 0.01
        yield from under("render what was edited", begin_and_escape(operators.render_pair))
    webbrowser.open, person.PATIENCE_S = open_page, patience
    lateness.leave_listeners()
    bounds = {action: LONGEST_S.get(action.partition(": ")[2], OTHERS_S) for action in lateness.rows}
    late = [action for action, row in lateness.rows.items() if row["longest_s"] > bounds[action]]
    check(not late, f"{', '.join(late)} held the window for too long:\n{lateness.summarize()}")
    return lateness.summarize()


STEPS = (
    open_the_tab,
    load_europa,
    calibration_by_mouse,
    build_by_mouse,
    undo_and_redo,
    camera_by_click,
    open_ground_panel,
    slide_by_mouse,
    render_by_mouse,
    pair_on_the_screen,
    escape_a_render,
    evaluate_by_mouse,
    measured_surface,
    lidar_by_f3,
    painted_errors,
    show_error,
    camera_image_follows,
    open_all_panels,  # so late because a button among all of them is found after minutes only
    render_a_data_set,
    vary_by_plus,
    vary_by_mouse,
    evaluate_other_pairs,
    preferences_page,
    find_a_setting,
    export_a_pair,
    ground_from_an_object,
    rocks_where_painted,
    search_and_clear,
    first_minute_by_keys,
    metrics_can_be_read,
    drag_an_asset,
    choose_by_picture,
    undo_by_key,
    cameras_beside_the_pair,
    render_in_a_local_view,
    turn_an_arm,
    dig_a_trench,
    decide_by_mouse,
    jobs_end_in_any_case,
    scenes_files_and_undo,
    count_late_turns,
)
NAMES = [step.__name__ for step in STEPS]
_LATER = calibration_by_mouse, camera_by_click, escape_a_render
#: From the opened tab to a measured pair.
FIRST_STEPS = [step for step in STEPS[: STEPS.index(evaluate_by_mouse) + 1] if step not in _LATER]


def write(finished: bool) -> None:
    (FOLDER / "steps.json").write_text(
        json.dumps({"blender": bpy.app.version_string, "finished": finished, "steps": steps}, indent=1)
    )


def walk() -> Waiting:
    yield 10 * TICK_S  # the window appears
    check(WANTED == ["first"] or {*WANTED} <= {*NAMES}, f"the steps are {', '.join(NAMES)}")
    start_watching()
    for step in FIRST_STEPS if WANTED == ["first"] else [each for each in STEPS if each.__name__ in (WANTED or NAMES)]:
        start = time.monotonic()
        record = {"step": step.__name__, "ok": False, "seconds": 0.0, "note": ""}
        steps.append(record)
        record["note"] = (yield from step()) or ""
        record |= {"ok": True, "seconds": round(time.monotonic() - start, 1)}
        print(f"STEP {step.__name__} {record['seconds']} s {record['note']}", flush=True)


def tick(walking: Waiting) -> float | None:
    began = time.monotonic()
    try:
        wanted = next(walking)
        ticks.append((began, time.monotonic()))
        return wanted
    except StopIteration:
        write(finished=True)
        bpy.ops.wm.quit_blender()
    except BaseException as error:
        traceback.print_exc()
        if steps:
            steps[-1]["note"] = f"{type(error).__name__}: {error}"
        subprocess.run(["import", "-window", "root", str(FOLDER / "99_failed.png")], check=False)
        write(finished=False)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(7)
    return None


faulthandler.enable()  # the lines of Python where Blender crashes
shutil.rmtree(FOLDER, ignore_errors=True)
FOLDER.mkdir(parents=True)
bpy.context.preferences.view.show_splash = False
walking = walk()
# A step opens files, which ends all other timers.
bpy.app.timers.register(lambda: tick(walking), first_interval=TICK_S, persistent=True)
