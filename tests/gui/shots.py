"""Take pictures of every state of the sidebar, the menus and the preferences, in both themes; runs in Blender.

    blender --python tests/gui/shots.py -- FOLDER [manual|narrow|themes]

With "manual" it takes those of the tutorial instead, FOLDER/window_*.png, which need an evaluator and some minutes.
With "narrow" it takes only those of a narrow sidebar, of the menus and of decisions on the ground; with "themes" all
panels in two widths and both themes.
Each state is a contact sheet FOLDER/THEME_STATE.png: the sidebar with all panels open, page beside page; double_STATE
is the same at twice the size, as on a HiDPI screen. A render that goes on and what opens are pictures of the whole
screen. Results are put there, not measured, and no evaluator is
needed. Meant to be looked at.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import person
from blend_layout import offset_of
from person import ADD_ON, TICK_S, Waiting, area, away, check, in_region, manager, middle, region, to, until, window

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
#: The 3D View with its sidebar, of the whole window.
MANUAL_CROP = "1320x904+0+0"
THEMES = {"dark": "Blender_Dark.xml", "light": "Blender_Light.xml"}


def module(name: str) -> Any:
    """A module of the installed extension."""
    return sys.modules[f"{ADD_ON}.{name}"]


def settings() -> bpy.types.PropertyGroup:
    return window().scene.icymoon


def screen_picture(path: Path, crop: str = "") -> Waiting:
    """Save what the screen shows, or a part ``WxH+X+Y`` of it, after a redraw."""
    for part in window().screen.areas:
        part.tag_redraw()
    yield 6 * TICK_S
    shot = subprocess.Popen(["import", "-window", "root", *(["-crop", crop, "+repage"] if crop else []), str(path)])
    yield from until(lambda: shot.poll() is not None, "A picture")


def picture_of_second_window(path: Path) -> Waiting:
    """Save what the second window shows."""
    other, height = manager().windows[1], window().height
    yield from screen_picture(path, f"{other.width}x{other.height}+{other.x}+{height - other.y - other.height}")


def picture(name: str) -> Waiting:
    """The whole screen."""
    yield from screen_picture(FOLDER / f"{name}.png")


def sheet(name: str) -> Waiting:
    """The whole sidebar, page beside page."""
    sidebar, pages = region("UI"), []
    crop = f"{sidebar.width}x{sidebar.height}+{sidebar.x}+{window().height - sidebar.y - sidebar.height}"
    yield from to(*middle("UI"))
    yield from person.scroll(-400)
    for number in range(30):
        yield from away()
        pages.append(FOLDER / f".{name}_{number:02d}.png")
        yield from screen_picture(pages[-1], crop)
        yield from to(*middle("UI"))
        before = person.scrolled()
        yield from person.scroll(int(21 / bpy.context.preferences.view.ui_scale))  # less than a page
        if abs(person.scrolled() - before) < 1:
            pages = pages[:-1] if number and before == 0 else pages
            break
    for first in range(0, len(pages), 5):
        target = FOLDER / f"{name}_{first // 5 + 1}.png"
        subprocess.run(["convert", *map(str, pages[first : first + 5]), "+append", str(target)], check=True)
    for page in pages:
        page.unlink()


# ---- the states -----------------------------------------------------------------------------------------------------


def open_panels() -> None:
    """Let all panels be open where they have not been drawn yet."""
    panels = [cls for cls in module("panels").CLASSES if issubclass(cls, bpy.types.Panel)]
    for cls in reversed(panels):
        bpy.utils.unregister_class(cls)
    for cls in panels:
        cls.bl_options = set()
        bpy.utils.register_class(cls)


def fresh() -> None:
    """As the extension is met."""


def built() -> None:
    """A built scene, its surface Hapke's, with an evaluation and a dry run behind it and a job under way."""
    with in_region("UI"):
        bpy.ops.icymoon.load_preset(preset="scenes/europa_ridged_plain_hapke")
        bpy.ops.icymoon.vary(setting="light.sun_elevation_deg")
        bpy.ops.icymoon.vary(setting="surface.model")
    settings().mesh.error_px, settings().mesh.edge_px = 8.0, 48.0
    settings().rocks.coverage, settings().rocks.own_surface = 0.05, True
    settings().quality.truth = "DEPTH"  # so that something is left out
    with in_region("WINDOW"):
        bpy.ops.icymoon.build_scene()
    area().spaces.active.shading.type = "SOLID"
    settings().terrain.rms_slope_deg += 1.0  # so that the preset was changed, and the roughness is of an earlier ground
    row = {
        "method": "bm",
        "total_bad_1": 0.35,
        "l1_m": 0.123,
        "l1_rate_10": 0.5,
        "si_rmse": None,
        "dod": 0.25,
        "coverage": 0.75,
    }
    settings().dataset.folder = str(FOLDER)
    (FOLDER / "evaluation_scene").mkdir(exist_ok=True)
    (FOLDER / "evaluation_scene" / "report.json").write_text(
        json.dumps(
            {
                "summary": [row, {**row, "method": "sgbm"}],
                "rows": [],
                "notes": [
                    "Noise of the render decides the result: in light or in shadow, more than 5 % of the pixels have "
                    "less texture than noise; raise quality.samples and look whether their order stays."
                ],
                "briefs": ["Noise of the render decides the result"],
                "provenance": {"created": "2038-06-01T12:00:00+00:00"},
            }
        )
    )
    module("operators.results").keep_results(
        bpy.context.scene, "SCENE", module("settings.blender.scene_properties").read_settings(settings()), ["0" * 12]
    )
    module("operators.dataset").readout.update(
        plan=settings().dataset.plan, lines=["12 pairs", "about 3 min and 40 MB on another machine with 1 process"]
    )
    jobs, session = module("operators.jobs"), module("operators.session").session
    process = SimpleNamespace(running=True, cancelled=False, stop=lambda: None, cancel=lambda: None)
    session.job = jobs.Job(
        "Render Stereo Pair", process, lambda message: None, lambda: None, time.monotonic() - 30, 1 / 3, "Left eye"
    )


def otherwise() -> None:
    """Other choices than the defaults: a mesh of one's own, images, planet by date, lens faults, landforms."""
    module("operators.session").session.job = None
    bpy.context.scene.icymoon.results = ""
    group = settings()
    for topic, key, value in (
        ("source", "kind", "MESH"),
        ("source", "detail", True),
        ("ridges", "height_m", 1.0),
        ("cracks", "depth_m", 0.2),
        ("chaos", "relief_m", 1.0),
        ("craters", "coverage", 0.2),
        ("hollows", "depth_m", 0.1),
        ("penitentes", "height_m", 1.0),
        ("pits", "depth_m", 0.2),
        ("mantle", "thickness_m", 0.1),
        ("surface", "model", "PRINCIPLED"),
        ("surface", "subsurface_weight", 0.5),
        ("surface", "grain_amplitude_m", 0.01),
        ("surface", "salt_share", 0.2),
        ("surface", "albedo_variation", 0.2),
        ("surface", "bubble_share", 0.02),
        ("surface", "frost_share", 0.3),
        ("surface", "crust_share", 0.2),
        ("surface", "glint_share", 0.03),
        ("textures", "set", "OWN"),
        ("rocks", "law", "POWER"),
        ("sensor", "colour", "BAYER"),
        ("rocks", "clustering", 0.5),
        ("light", "directions_from", "KERNELS"),
        ("light", "planet", True),
        ("light", "stars", True),
        ("sensor", "auto_exposure", False),
        ("sensor", "brackets", 3),
        ("sensor", "radiation_flux_cm2_s", 1.0e4),
        ("rig", "motion_exposure_s", 0.01),
        ("lander", "kind", "PARAMETRIC"),
        ("excavation", "path", "ARC"),
    ):
        setattr(getattr(group, topic), key, value)


def stand_ins() -> None:
    """Ground and textures that stand in for the paper's, with the Sun by angles again."""
    settings().source.kind, settings().textures.set = "STAND_IN", "STAND_IN"
    settings().light.directions_from = "ANGLES"


def make_narrow(px: int) -> Waiting:
    """Give the sidebar a width. Dragging its edge by mouse takes minutes where OpenGL is in software, and Python may
    not set it, so it is written to where Blender keeps it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "layout.blend"
        with in_region("WINDOW"):
            bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=False)
        offset = offset_of("ARegion", "sizex", path.read_bytes())
    ctypes.c_short.from_address(region("UI").as_pointer() + offset).value = px
    for shown in (False, True):  # after which Blender lays the regions out anew
        area().spaces.active.show_region_ui = shown
        yield 10 * TICK_S
    yield from until(
        lambda: abs(region("UI").width - px * bpy.context.preferences.system.ui_scale) < 3, "Making the sidebar narrow"
    )


def decided() -> None:
    """Decisions on the ground, with a site and a reach."""
    maps = module("stereo.decisions.stored_maps")
    reach = np.zeros((60, 80), bool)
    reach[10:50, 15:65] = True
    values = np.linspace(-0.5, 0.5, reach.size).reshape(reach.shape)
    stored = maps.StoredMap(
        maps.SUITABILITY,
        module("stereo.decisions.dem").Grid(0.05, 60, 80, -2.0, 5.0),
        values,
        np.zeros(reach.shape),
        reach,
        (30, 40),
        0.3,
        10.0,
    )
    scene = bpy.context.scene
    find_build = partial(module("nodes.build_scene").find_built, scene)
    collection = module("support.steps").finish(
        module("nodes.painted_decisions").paint_decisions(find_build, stored, "StereoBM")
    )
    module("operators.coloured_views").show_colours(bpy.context, list(collection.objects), solid=True)
    module("panels.decision_maps").list_decided_methods = lambda _: ["bm", "true depth"]


def rendering() -> Waiting:
    """A render that goes on: how far it is stands in the sidebar and in the status bar."""
    with in_region("UI"):
        bpy.ops.icymoon.load_preset(preset="scenes/europa_rough_ice")
    settings().mesh.error_px, settings().mesh.edge_px = 8.0, 48.0
    settings().rig.width_px, settings().rig.height_px = 240, 180
    settings().quality.samples, settings().dataset.folder = 2000, str(FOLDER / "pairs")
    with in_region("WINDOW"):
        bpy.ops.icymoon.render_pair("INVOKE_DEFAULT")
    yield from to(*middle("UI"))
    yield from person.scroll(-400)
    yield from away()
    session = module("operators.session").session
    yield from until(lambda: session.job is None or session.job.fraction > 0.02, "Progress of a render")
    check(session.job, "the render ended before its picture was taken")


def cancelled() -> Waiting:
    """The render is stopped."""
    session = module("operators.session").session
    with in_region("UI"):
        bpy.ops.icymoon.cancel()
    yield from until(lambda: session.job is None, "Cancelling")


def scene_pictures() -> Waiting:
    """The pictures of the scenes, one of which is pointed at."""
    x, y = yield from person.over_the_pictures()
    person.xdotool("click", 1)
    yield 15 * TICK_S
    person.point(x - 400, y - 180)
    yield 15 * TICK_S


def sharing(name: str) -> Callable[[], Waiting]:
    """A menu that stands open."""

    def show() -> Waiting:
        yield from away()
        with in_region("WINDOW"):
            bpy.ops.wm.call_menu("INVOKE_DEFAULT", name=name)
        yield 10 * TICK_S

    return show


def in_both_themes(name: str, take: Callable[[str], Waiting]) -> Waiting:
    for theme, file in THEMES.items():
        found = next(
            path for folder in bpy.utils.preset_paths("interface_theme") if (path := Path(folder, file)).is_file()
        )
        with in_region("WINDOW"):
            bpy.ops.script.execute_preset(filepath=str(found), menu_idname="USERPREF_MT_interface_theme_presets")
        yield from take(f"{theme}_{name}")
        print("SHOT", theme, name, flush=True)


def at_double_size(name: str) -> Waiting:
    """The sidebar as on a screen with twice as many pixels per inch."""
    view = bpy.context.preferences.view
    view.ui_scale = 2.0
    yield 15 * TICK_S
    yield from sheet(f"double_{name}")
    view.ui_scale = 1.0
    yield 15 * TICK_S
    print("SHOT", "double", name, flush=True)


def workspace(name: str) -> Waiting:
    """Go to another workspace, whose sidebar has not been drawn, and give its 3D View the window."""
    window().workspace = bpy.data.workspaces[name]
    yield 10 * TICK_S
    with in_region("WINDOW"):
        bpy.ops.screen.screen_full_area()
    yield 10 * TICK_S
    with in_region("WINDOW"):
        bpy.ops.object.mode_set(mode="OBJECT")
    area().spaces.active.show_region_ui = False
    yield 10 * TICK_S
    yield from person.open_the_tab()


def walk() -> Waiting:
    yield 10 * TICK_S  # the window appears
    person.start_watching()
    yield from workspace("Layout")
    yield from in_both_themes("met", picture)
    open_panels()
    yield from workspace("Modeling")
    for state in (fresh, built, otherwise):
        state()
        yield 15 * TICK_S
        yield from in_both_themes(state.__name__, sheet)
        if state is built:
            yield from at_double_size(state.__name__)
    yield from rendering()
    yield from in_both_themes("rendering", picture)
    yield from cancelled()
    yield from scene_pictures()
    yield from picture("menu_scenes")
    person.xdotool("key", "Escape")
    yield 10 * TICK_S
    yield from menus()

    def preferences(name: str) -> Waiting:
        yield from person.open_preferences()
        yield from picture(name)
        yield from person.close_second_window("the preferences")

    yield from in_both_themes("preferences", preferences)
    stand_ins()
    yield from make_narrow(200)
    yield from sheet("narrow_stand_ins")
    built()
    yield 15 * TICK_S
    yield from sheet("narrow_built")


def menus() -> Waiting:
    """The menus, each open."""
    for menu in (
        "ICYMOON_MT_presets",
        "ICYMOON_MT_presets_terrains",
        "ICYMOON_MT_icymoon",
        "ICYMOON_MT_dataset",
        "TOPBAR_MT_render",
        "VIEW3D_MT_mesh_add",
    ):
        yield from sharing(menu)()
        yield from picture(f"menu_{menu}")
        person.xdotool("key", "Escape")
        yield 10 * TICK_S


def themes() -> Waiting:
    """All panels in both themes, in a sidebar as Blender opens it and in the narrowest."""
    yield 10 * TICK_S
    person.start_watching()
    open_panels()
    yield from workspace("Modeling")
    area().spaces.active.shading.type = "WIREFRAME"
    for width in (280, 200):
        yield from make_narrow(width)
        for state in (built, otherwise):
            state()
            module("operators.session").session.job = None
            yield 15 * TICK_S
            yield from in_both_themes(f"{width}_{state.__name__}", sheet)


def narrow() -> Waiting:
    """Texts in the narrowest sidebar, menus, and decisions on the ground."""
    yield 10 * TICK_S
    person.start_watching()
    yield from menus()
    open_panels()
    yield from workspace("Modeling")
    area().spaces.active.shading.type = "WIREFRAME"
    yield from make_narrow(200)
    print("SHOT narrow", region("UI").width, flush=True)
    built()
    module("operators.session").session.job = None
    yield 15 * TICK_S
    yield from sheet("narrow_built")
    with in_region("WINDOW"):
        decided()
    yield from make_narrow(280)
    yield from to(*middle("UI"))
    yield from person.scroll(400)
    yield from away()
    yield from picture("decisions")


def for_the_manual() -> Waiting:
    """The steps of the tutorial, each with its picture; the numbers in them are measured."""
    yield 10 * TICK_S
    person.start_watching()
    yield from person.open_the_tab()
    yield from screen_picture(FOLDER / "window_sidebar.png", MANUAL_CROP)
    with in_region("UI"):
        bpy.ops.icymoon.load_preset(preset="scenes/europa_rough_ice")
    settings().quality.samples, settings().dataset.folder = 8, str(FOLDER / "pairs")
    with in_region("WINDOW"):
        bpy.ops.icymoon.build_scene()
    resolution = module("operators.view_resolution")
    while bpy.app.timers.is_registered(resolution._refine_resting_view):  # until the view rests
        yield TICK_S
    yield from screen_picture(FOLDER / "window_built.png", MANUAL_CROP)
    area().spaces.active.shading.type = "SOLID"
    session = module("operators.session").session
    for step in ("render_pair", "evaluate"):
        with in_region("WINDOW"):
            getattr(bpy.ops.icymoon, step)("INVOKE_DEFAULT")
        while session.job:
            yield TICK_S
        if step == "render_pair":
            yield from until(lambda: len(manager().windows) == 2, "Showing the pair")
            yield 20 * TICK_S
            yield from picture_of_second_window(FOLDER / "window_pair.png")
            yield from person.close_second_window("the Image Editor")
    yield 20 * TICK_S
    yield from to(*middle("UI"))
    yield from person.scroll(7)  # down to the results
    yield from away()
    yield from screen_picture(FOLDER / "window_evaluated.png", MANUAL_CROP)
    with in_region("WINDOW"):
        bpy.ops.icymoon.show_surface()
    yield 30 * TICK_S
    yield from screen_picture(FOLDER / "window_surface.png", MANUAL_CROP)


def tick(walking: Waiting) -> float | None:
    try:
        return next(walking)
    except StopIteration:
        bpy.ops.wm.quit_blender()
    except BaseException:
        traceback.print_exc()
        subprocess.run(["import", "-window", "root", str(FOLDER / "failed.png")], check=False)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(7)
    return None


check(bpy.context.preferences.addons.get(ADD_ON), "the extension is not enabled")
shutil.rmtree(FOLDER, ignore_errors=True)
FOLDER.mkdir(parents=True)
bpy.context.preferences.view.show_splash = False
walking = {"manual": for_the_manual, "narrow": narrow, "themes": themes}.get(sys.argv[-1], walk)()
bpy.app.timers.register(lambda: tick(walking), first_interval=TICK_S)
