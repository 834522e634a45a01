"""Forty sequences of actions on scenes, files and undo, and what must hold after each action.

``TABLE`` has a name and actions in their order, separated by |, for each. The same table runs in Blender as a
Python module (``tests/operators/test_scene_sequences.py``) and in the window of a real Blender (``tests/gui``), where
``icymoon`` has another name; so the caller gives a function that finds the modules of the extension.

Words of the table that are no action state what must hold of the present scene; ``same``: as many data-blocks as at
``count``.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Container, Generator, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np

Waiting = Generator[float, None, None]
TAG = "icymoon"
#: Settings of every scene: a ground of 81 vertices and a pair of 192 pixels.
TINY: dict[str, dict[str, Any]] = {
    "terrain": {"resolution": 9, "size_m": 8.0},
    "mesh": {"kind": "GRID"},
    "rocks": {"coverage": 0.05, "smallest_m": 0.5, "most": 5},
    "rig": {"width_px": 16, "height_px": 12},
    "quality": {"samples": 1, "threads": 2, "denoiser": "NONE"},
}
#: The user's own camera, cube and world in the first scene of every file that a sequence begins.
CAMERA, CUBE, WORLD = "My Camera", "My Cube", "My World"
_KINDS = (
    "objects",
    "meshes",
    "materials",
    "lights",
    "cameras",
    "worlds",
    "collections",
    "node_groups",
    "images",
    "textures",
)
_COLOUR = "icymoon_depth_error_colour"  # attribute of a ground with painted colours
#: Where a sequence runs: without a window in a moment; likewise, but a pair is rendered; with a window only.
QUICK, RENDERS, WINDOW = "quick", "renders", "window"

#: One sequence a line, which goes on where the next is indented.
TABLE = """
# undo
undo and redo a build: build | built | undo | empty | redo | built | undo | empty | build | built
build again and again: build | build | count | build | build | same | undo | built
undo Clear Scene: build | clear | empty | undo | built | redo | empty | undo | built | build
undo a preset: build | preset | coarse | undo | fine | redo | undo | undo | empty
undo a slider: build | slide | coarse | undo | fine | redo | coarse | undo | fine
undo a slider, then build: build | slide | undo | build | fine | slide | build | fine | undo | coarse
slide without live preview: build | live off | slide | stale | build | fine | undo | undo | fine
undo over a render: build | render | slide | undo | rendered | render | undo | built
undo painted errors: build | measure | paint | undo | bare | redo | painted | hide | undo | undo
build under painted errors: build | measure | paint | build | bare | undo | painted | slide | bare
clear under painted errors: build | measure | paint | clear | bare | undo | painted | undo | bare
undo decisions: build | measure | decide | undo | bare | redo | painted | build | bare
# scenes of one file
two scenes: build | new scene | build | scene 1 | build | scene 2 | built | clear | scene 1 | built
render two scenes: build | render | new scene | build | render | scene 1 | render
measure two scenes: build | measure | paint | new scene | build | measure | paint | hide | scene 1 | painted
undo in the second scene: build | new scene | build | undo | empty | scene 1 | built | build
full copy: build | full copy | built | slide | build | fine | scene 1 | fine
full copy of painted errors: build | measure | paint | full copy | build | bare | scene 1 | painted
linked copy: build | linked copy | slide | build | fine | scene 1 | fine | build | scene 2 | fine
clear a linked copy: build | linked copy | clear | empty | scene 1 | built | clear | empty
copy of the settings: build | settings copy | empty | build | scene 1 | built | build
delete a built scene: build | new scene | build | delete scene | built | build
# parts renamed or deleted
rename all: build | rename | built | build | slide | build | fine | clear | empty
delete ground, Sun and camera: build | delete terrain | empty | undo | redo | delete camera | delete sun | purge |
    build
delete the collection: build | count | delete collection | empty | build | same | clear | empty
purge unused data: build | slide | purge | undo | undo | built | clear | purge | undo | undo | built
# files
save and open: build | save | open | built | build | count | build | same | clear | empty
save and open painted errors: build | measure | paint | save | open | painted | measured | hide
save and open a preview: build | slide | save | open | coarse | build | fine
append a whole scene: build | save | new file | build | append scene | built | scene 2 | built | slide | build |
    fine
append the collection: build | save | new file | append | built | slide | build | fine | clear | empty | undo
append, then render: build | save | new file | append | undo | empty | redo | built | render
append beside a built scene: build | save copy | append | built | build | slide | undo | clear | empty | build
link, then override: build | save | new file | link | empty | build | clear | override | empty | build
# while something runs
undo while a pair renders: build | slide | build | start render | undo | undo | wait | rendered
other scene while a pair renders: build | new scene | scene 1 | start render | scene 2 | wait | unrendered | scene 1
    | rendered
rename and delete scenes while a pair renders: build | new scene | start render | rename | wait | rendered | start
    render again | delete scene | wait | built
open a file while a pair renders: build | save | start render | open | wait | unrendered | built | render
a new file while the ground is made: pick | coarse | new file | empty | build | built
undo while the ground is made: build | pick | coarse | undo | fine | redo | wait | fine | undo | fine
"""


@dataclass(frozen=True)
class Sequence:
    """One line of the table."""

    name: str
    words: tuple[str, ...]

    @property
    def needs(self) -> str:
        """Where it can run."""
        if {"start render", "pick"} & {*self.words}:
            return WINDOW
        return RENDERS if {"render", "measure"} & {*self.words} else QUICK


def read_table(text: str) -> tuple[Sequence, ...]:
    """The sequences of a table."""
    lines = [line for line in text.replace("\n    ", " ").splitlines() if line and not line.startswith("#")]
    found = (line.partition(": ") for line in lines)
    return tuple(Sequence(name, tuple(map(str.strip, actions.split("|")))) for name, _, actions in found)


SEQUENCES = read_table(TABLE)


@dataclass
class Runner:
    """Runs sequences. ``module`` finds a module of the extension.

    Of a window are ``in_view``, a context in a 3D View, and ``until``, which waits until something holds.
    """

    module: Callable[[str], Any]
    folder: Path
    in_view: Callable[[], AbstractContextManager[Any]] = nullcontext
    until: Callable[[Callable[[], object], str], Waiting] | None = None
    counted: dict[str, int] = field(default_factory=dict)
    mine: bool = True  # whether the user's own objects belong in the file
    deleted: bool = False  # whether the user has deleted something built, until the next build

    @property
    def windowed(self) -> bool:
        return self.until is not None

    @property
    def scene(self) -> bpy.types.Scene:
        """The scene that the window shows."""
        return bpy.context.window_manager.windows[0].scene if self.windowed else bpy.context.scene

    def run(self, sequence: Sequence) -> Waiting:
        """Run a sequence in a new file. Raises AssertionError where something does not hold."""
        yield from self.do_begin()
        for place, word in enumerate(sequence.words, 1):
            try:
                if (state := STATES.get(word)) is not None:
                    if word == "fine":  # the ground follows from another process, also after undo and redo
                        yield from self.do_wait()
                    assert state(self), f"the scene is not {word}"
                else:
                    yield from self.act(word)
                self.check_all()
            except Exception as error:
                raise AssertionError(
                    f"{sequence.name}: after action {place}, {word}: {type(error).__name__}: {error}"
                ) from error

    def act(self, word: str) -> Waiting:
        """Do one action, of one or more words or with an argument, and let the window draw it."""
        action, _, argument = word.partition(" ")
        whole = getattr(self, f"do_{word.replace(' ', '_')}", None)
        done = whole() if whole is not None else getattr(self, f"do_{action}")(argument)
        if done is not None:
            yield from done
        yield from self.settle()

    def settle(self) -> Waiting:
        """Let timers run that answer an action."""
        if self.windowed:
            for _ in range(3):
                yield 0.05
        else:
            live = self.module("operators.live_preview")
            live.show_waiting()
            self.module("operators.window_events").cancel_call(live.show_waiting)  # no timer runs without a window

    # ---- what the actions need ---------------------------------------------------------------------------------------

    def operator(self, name: str, *how: Any, **options: Any) -> None:
        """Call one of our operators as its button does; an undo step follows."""
        with self.in_view():
            found = getattr(bpy.ops.icymoon, name)
            assert found.poll(), f"{name} is not possible"
            if self.windowed:
                result = found("INVOKE_DEFAULT" if not how else how[0], True, **options)
            else:
                result = found("EXEC_DEFAULT", True, **options)
            assert result <= {"FINISHED", "RUNNING_MODAL"}, f"{name} ended with {result}"

    def step(self, message: str) -> None:
        """An undo step after something that Blender's own button would take one for."""
        with self.in_view():
            bpy.ops.ed.undo_push(message=message)

    def call(self, function: Callable[..., Any], **options: Any) -> None:
        with self.in_view():
            function(**options)

    @property
    def built(self) -> Any:
        return self.module("nodes.build_scene").find_built(self.scene)

    @property
    def path(self) -> Path:
        return self.folder / "saved.blend"

    @property
    def session(self) -> Any:
        return self.module("operators.session").session

    def settings(self, scene: bpy.types.Scene) -> Any:
        return self.module("settings.blender.scene_properties").read_settings(scene.icymoon)

    def make_tiny(self, seed: int) -> None:
        """Give the scene settings of its own."""
        parts = {**TINY, "dataset": {"folder": str(self.folder / "dataset"), "seed": seed, "methods": "bm"}}
        self.module("settings.blender.scene_properties").write_settings(self.scene.icymoon, parts)

    # ---- actions ----------------------------------------------------------------------------------------------------

    def do_begin(self) -> Waiting:
        """An empty file with the user's own camera, cube and world."""
        self.mine, self.deleted = True, False
        self.call(bpy.ops.wm.read_homefile, use_empty=True, use_factory_startup=True)
        yield from self.settle()
        scene = self.scene
        for name, data in ((CAMERA, bpy.data.cameras.new(CAMERA)), (CUBE, bpy.data.meshes.new(CUBE))):
            scene.collection.objects.link(bpy.data.objects.new(name, data))
        scene.camera, scene.world = bpy.data.objects[CAMERA], bpy.data.worlds.new(WORLD)
        bpy.data.objects[CUBE].location = 1.0, 2.0, 3.0
        self.make_tiny(1)
        self.step("Begin")

    def do_build(self) -> Waiting:
        self.operator("build_scene")
        self.deleted = False
        yield from self.do_wait()

    def do_clear(self) -> None:
        self.operator("clear_scene")

    def do_undo(self) -> None:
        self.call(bpy.ops.ed.undo)

    def do_redo(self) -> None:
        self.call(bpy.ops.ed.redo)

    def do_preset(self) -> None:
        self.operator("load_preset", "EXEC_DEFAULT", preset="terrains/penitentes")

    def do_pick(self) -> None:
        """Choose a scene by its picture: a coarse ground at once, the fine one follows."""
        self.operator("load_preset", "EXEC_DEFAULT", preset="scenes/europa_rough_ice", build=True)

    def do_slide(self) -> None:
        terrain = self.scene.icymoon.terrain
        terrain.rms_slope_deg += 3.0
        self.module("operators.live_preview").show_waiting()
        self.step("Slide")

    def do_live_off(self) -> None:
        self.scene.icymoon.live = False
        self.step("Live Preview")

    def do_wait(self) -> Waiting:
        """Wait until no job runs and no fine ground follows."""
        if self.until is not None:
            refine = self.module("operators.refine_ground")
            yield from self.until(lambda: self.session.job is None and self.session.building is None, "Ending the job")
            yield from self.until(
                lambda: not any(map(refine.describe_refining, bpy.data.scenes)), "Making the fine ground"
            )

    def do_start_render(self, **options: bool) -> Waiting:
        """Render, and wait until the scene is prepared."""
        self.operator("render_pair", **options)
        assert self.until is not None
        in_pieces = self.module("operators.work_in_pieces").WorkInPieces
        yield from self.until(
            lambda: self.session.job is not None and not isinstance(self.session.job.process, in_pieces),
            "Starting the render",
        )

    def do_start_render_again(self) -> Waiting:
        yield from self.do_start_render(again=True)

    def do_render(self) -> Waiting:
        if self.windowed:
            yield from self.do_start_render()
            yield from self.do_wait()
            self.close_windows()
        else:
            self.operator("render_pair")
            self.step("Render")
        assert rendered(self), "the pair is not there"

    def close_windows(self) -> None:
        """Close the Image Editor that shows the pair."""
        for window in list(bpy.context.window_manager.windows)[1:]:
            with bpy.context.temp_override(window=window):
                bpy.ops.wm.window_close()

    def do_measure(self) -> Waiting:
        """Render, and leave what an evaluation with one matcher leaves."""
        yield from self.do_render()
        results, properties = self.module("operators.results"), self.module("settings.blender.scene_properties")
        scene, files = self.scene, self.module("stereo.images.image_files")
        settings = properties.read_settings(scene.icymoon)
        (pair,) = scene.icymoon.pairs.split()
        folder = results.find_evaluation_folder(settings, "SCENE")
        (folder / pair).mkdir(parents=True, exist_ok=True)
        files.write_disparity(folder / pair / "bm.npz", np.full((12, 16), 1.0, np.float32))
        row = {"method": "bm", "total_bad_1": 0.3, "coverage": 1.0, "l1_m": 0.1, "l1_rate_10": 0.1, "si_rmse": None}
        (folder / "summary.json").write_text(
            json.dumps(
                {
                    "summary": [{**row, "dod": 0.1}],
                    "shown": [{"method": "bm", "images": {"disparity": f"{pair}/bm.npz"}}],
                    "provenance": {"created": f"2038-06-01T12:34:56+00:00 {scene.name}", "response_overrides": {}},
                }
            )
        )
        (folder / "report.html").write_text("<html></html>")
        results.keep_results(scene, "SCENE", settings, [pair])
        self.step("Evaluate")

    def do_paint(self) -> Waiting:
        self.operator("paint_errors", method="bm")
        yield from self.do_wait()

    def do_hide(self) -> None:
        self.operator("hide_surface")

    def do_decide(self) -> None:
        """Show a map of decisions on the ground."""
        stored, dem = self.module("stereo.decisions.stored_maps"), self.module("stereo.decisions.dem")
        shape = 80, 80
        one = stored.StoredMap(
            stored.SUITABILITY,
            dem.Grid(0.1, *shape, -4.0, 4.0),
            np.zeros(shape),
            np.zeros(shape),
            np.ones(shape, bool),
            (3, 7),
            0.3,
            10.0,
        )
        built = self.built
        self.module("support.steps").finish(
            self.module("nodes.painted_decisions").paint_decisions(lambda: built, one, "StereoBM")
        )
        self.step("Show Decisions")

    def do_new_scene(self, kind: str = "NEW") -> None:
        self.call(bpy.ops.scene.new, type=kind)
        if kind in ("NEW", "EMPTY"):
            self.make_tiny(len(bpy.data.scenes))
        self.step("New Scene")

    def do_full_copy(self) -> None:
        self.do_new_scene("FULL_COPY")

    def do_linked_copy(self) -> None:
        self.do_new_scene("LINK_COPY")

    def do_settings_copy(self) -> None:
        self.do_new_scene("EMPTY")

    def do_scene(self, number: str) -> None:
        """Switch to a scene, by its place in the order of their making."""
        scene = sorted(bpy.data.scenes, key=lambda each: each.session_uid)[int(number) - 1]
        bpy.context.window_manager.windows[0].scene = scene
        self.step("Scene")

    def do_delete_scene(self) -> None:
        self.deleted = True
        self.call(bpy.ops.scene.delete)
        self.step("Delete Scene")

    def do_rename(self) -> None:
        """New names for the scene, the built collections and all in them."""
        scene, collection = self.scene, self.module("nodes.build_scene").find_collection(self.scene)
        scene.name = "Landing Site"
        for block in (collection, *collection.children_recursive, *collection.all_objects):
            block.name = f"X.{block.name}"
        for item in collection.all_objects:
            if item.data is not None:
                item.data.name = "Y"
        self.step("Rename")

    def do_delete(self, part: str) -> None:
        """Delete a built object or the built collection, as the outliner does."""
        self.deleted = True
        collection = self.module("nodes.build_scene").find_collection(self.scene)
        if part == "collection":
            for child in (collection, *collection.children_recursive):
                for item in child.objects:
                    self.scene.collection.objects.link(item)
            bpy.data.batch_remove([collection, *collection.children_recursive])
        else:
            bpy.data.objects.remove(next(item for item in collection.all_objects if item.get(TAG) == part))
        self.step("Delete")

    def do_purge(self) -> None:
        bpy.data.orphans_purge(do_local_ids=True, do_linked_ids=True, do_recursive=True)
        self.step("Purge")

    def do_save(self) -> None:
        self.call(bpy.ops.wm.save_as_mainfile, filepath=str(self.path), check_existing=False)

    def do_save_copy(self) -> None:
        self.call(bpy.ops.wm.save_as_mainfile, filepath=str(self.path), check_existing=False, copy=True)

    def do_open(self) -> Waiting:
        self.call(bpy.ops.wm.open_mainfile, filepath=str(self.path))
        yield from self.settle()
        self.step("Open")

    def do_new_file(self) -> Waiting:
        self.mine = False
        self.call(bpy.ops.wm.read_homefile, use_empty=True, use_factory_startup=True)
        yield from self.settle()
        self.make_tiny(9)
        self.step("New File")

    def do_append(self) -> None:
        self.call(bpy.ops.wm.append, directory=f"{self.path}/Collection/", filename="Icy Moon")
        self.step("Append")

    def do_append_scene(self) -> None:
        self.call(bpy.ops.wm.append, directory=f"{self.path}/Scene/", filename="Scene")
        self.mine = True  # a scene brings all that is in it
        self.step("Append")

    def do_link(self) -> None:
        self.call(
            bpy.ops.wm.link, directory=f"{self.path}/Collection/", filename="Icy Moon", instance_collections=False
        )
        self.step("Link")

    def do_override(self) -> None:
        """Make a library override of the linked collection."""
        linked = next(c for c in bpy.data.collections if c.get(TAG) == "scene" and c.library)
        view_layer = self.scene.view_layers[0]
        assert linked.override_hierarchy_create(self.scene, view_layer, do_fully_editable=True) is not None
        self.step("Override")

    def do_count(self) -> None:
        self.counted = count_blocks()

    # ---- what must hold after each action --------------------------------------------------------------------------

    def check_all(self) -> None:
        """Raise AssertionError if a scene shows what is not its own, or something is left over."""
        faults = [*self.find_leftovers(), *(fault for scene in bpy.data.scenes for fault in self.find_faults(scene))]
        faults += self.find_view_faults() if self.windowed else []
        assert not faults, "; ".join(faults)

    def find_leftovers(self) -> Iterator[str]:
        """Data-blocks that nobody uses, and colours on a ground whose scene shows none."""
        for kind in () if self.deleted else _KINDS:
            for block in getattr(bpy.data, kind):
                if block.users == 0 and (TAG in block or block.name.startswith("Icy Moon")) and block.library is None:
                    yield f"{kind} {block.name} has no user"
        painted = self.module("nodes.painted_errors")
        shown = {
            item.data
            for scene in bpy.data.scenes
            if painted.find_painted(scene)
            for item in scene.objects
            if item.type == "MESH"
        }
        for mesh in bpy.data.meshes:
            if _COLOUR in mesh.attributes and mesh not in shown and not mesh.name.startswith("Icy Moon Rock Shape"):
                yield f"{mesh.name} has colours that no scene shows"

    def find_faults(self, scene: bpy.types.Scene) -> Iterator[str]:
        """What does not hold of one scene."""
        ours = [
            c
            for c in scene.collection.children_recursive
            if c.get(TAG) == "scene" and c.library is None and c.override_library is None
        ]
        if len(ours) > 1:
            yield f"{scene.name} has {len(ours)} built collections"
        yield from self.find_strays(scene)
        built = self.module("nodes.build_scene").find_built(scene)
        if built is None:
            for item in (scene.camera, scene.world):
                if item is not None and TAG in item and not ours and not self.deleted:
                    yield f"{scene.name} has {item.name} and nothing is built"
            return
        if scene.camera != built.camera:
            yield f"{scene.name} looks through {scene.camera and scene.camera.name}, not through {built.camera.name}"
        if scene.world is None or TAG not in scene.world:
            yield f"{scene.name} has the world {scene.world and scene.world.name}"
        if built.edited:
            yield f"{scene.name} counts as edited by hand: {sorted(built.edited_parts())}"
        settings, notes = self.settings(scene), self.module("nodes.preview").read_notes(scene)
        merged = self.module("settings.description").merged
        differing = self.module("nodes.build_scene").list_changed_settings(built, settings)
        if differing and merged(built.settings, built.preview) != settings and not notes:
            yield f"{scene.name} is not what its panel shows: {differing[:3]}"
        yield from self.find_foreign_results(scene)

    def find_view_faults(self) -> Iterator[str]:
        """What does not hold of the 3D Views: they show the built scene of their window, or are as they were before."""
        for window in bpy.context.window_manager.windows:
            built = self.module("nodes.build_scene").find_built(window.scene)
            for space in (area.spaces.active for area in window.screen.areas if area.type == "VIEW_3D"):
                shown = space.as_pointer() in self.session.views_before
                through = space.camera if space.use_local_camera else window.scene.camera
                if shown and not self.deleted and (built is None or through != built.camera):
                    yield f"a view of {window.scene.name} shows {through and through.name}"
                if not shown and built is None and (space.local_view or not space.overlay.show_overlays):
                    yield f"a view of {window.scene.name} is still as that of a built scene"
                if space.shading.type == "SOLID" and space.shading.color_type == "VERTEX" and not painted(self):
                    yield f"a view of {window.scene.name} is still in the colours of errors"

    def find_foreign_results(self, scene: bpy.types.Scene) -> Iterator[str]:
        """Results and pairs of a scene that others made."""
        kept = self.module("operators.results").read_stored_results(scene)
        if kept is not None and kept.settings.dataset.seed != scene.icymoon.dataset.seed:
            yield f"{scene.name} has results of another scene"

    def find_strays(self, scene: bpy.types.Scene) -> Iterator[str]:
        """Objects that are neither the user's nor in the collections of what is built, painted or measured."""
        roles = ("scene", "painted errors", "measured surface")
        ours = {item for c in scene.collection.children_recursive if c.get(TAG) in roles for item in c.all_objects}
        others = [item for item in scene.objects if item not in ours]
        if not self.mine:
            yield from (f"{item.name} has come into {scene.name}" for item in others)
        for name in (CAMERA, CUBE):
            if sum(item.name.startswith(name) for item in others) > 1:
                yield f"{scene.name} has {name} twice"
        if not self.deleted:
            yield from (f"{item.name} has come into {scene.name}" for item in others if TAG in item)


def count_blocks() -> dict[str, int]:
    """Number of data-blocks of every kind."""
    return {kind: len(getattr(bpy.data, kind)) for kind in _KINDS}


def rendered(runner: Runner) -> bool:
    """Whether the pairs that the scene names are there."""
    names = runner.scene.icymoon.pairs.split()
    return bool(names) and all((runner.folder / "dataset" / "pairs" / name / "pair.json").is_file() for name in names)


def painted(runner: Runner) -> bool:
    """Whether the scene shows colours, on its own ground."""
    shown = runner.module("nodes.painted_errors").find_painted(runner.scene) is not None
    return shown and runner.built is not None and _COLOUR in runner.built.terrain.data.attributes


def is_coarse(runner: Runner) -> bool:
    return runner.built is not None and bool(runner.built.preview)


def is_fine(runner: Runner) -> bool:
    """Whether the ground is as Build Scene would make it from the settings."""
    scenes, built = runner.module("nodes.build_scene"), runner.built
    return (
        built is not None
        and not built.preview
        and not scenes.list_changed_settings(built, runner.settings(runner.scene))
    )


def is_stale(runner: Runner) -> bool:
    """Whether the sidebar tells that the ground is not that of the settings."""
    return any("press Build Scene" in note for note in runner.module("nodes.preview").read_notes(runner.scene))


def is_measured(runner: Runner) -> bool:
    return runner.module("operators.results").read_stored_results(runner.scene) is not None


def is_same(runner: Runner) -> bool:
    now = count_blocks()
    assert now == runner.counted, {
        kind: (runner.counted[kind], n) for kind, n in now.items() if n != runner.counted[kind]
    }
    return True


def negate(state: Callable[[Runner], bool]) -> Callable[[Runner], bool]:
    return lambda runner: not state(runner)


def is_built(runner: Runner) -> bool:
    return runner.built is not None


STATES: dict[str, Callable[[Runner], bool]] = {
    "built": is_built,
    "empty": negate(is_built),
    "coarse": is_coarse,
    "fine": is_fine,
    "stale": is_stale,
    "painted": painted,
    "bare": negate(painted),
    "measured": is_measured,
    "unmeasured": negate(is_measured),
    "rendered": rendered,
    "unrendered": negate(rendered),
    "same": is_same,
}


def run_all(runner: Runner, wanted: Container[int]) -> Generator[float, None, list[str]]:
    """Run the sequences with the ``wanted`` numbers, from 1, and print a line for each; returns what failed."""
    faults = []
    for number, sequence in enumerate(SEQUENCES, 1):
        if number not in wanted:
            continue
        fault, began = "", time.monotonic()
        try:
            yield from runner.run(sequence)
        except AssertionError as error:
            job = runner.session.job
            fault = str(error) + (f" ({job.shown}, running: {job.process.running})" if job else "")
            faults.append(fault)
            runner.session.reset()
        state, seconds = "FAILED" if fault else "passed", time.monotonic() - began
        line = f"SEQUENCE {number:2} {state} {seconds:5.1f} s  {fault or sequence.name}"
        print(line, flush=True)
        with (runner.folder / "table.txt").open("a") as table:
            table.write(f"{line}\n")
    return faults
