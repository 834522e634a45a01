"""The longest pieces of the work that the extension does in Blender's own thread, by action.

    python benchmarks pieces                          two scenes with their ground in full
    python benchmarks pieces europa_rough_ice …       scenes of presets by their names

Each action runs as the window runs it: piece by piece, with its threads awaited between them. Milliseconds are of the
processor time of Blender's thread, so that a busy machine changes them little. A piece is named by the line at which it
ended, or by the function that is one piece. A window may hold a little longer, since it draws what has changed. Needs
Blender as a module and the evaluator's packages.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import GeneratorType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
from icymoon.benchmarks.common.arguments import scratch
from icymoon.benchmarks.common.renders import open_empty_file, start_blender
from icymoon.nodes.ground.terrain_mesh import build_mesh_from_arrays
from icymoon.operators import (
    build_in_pieces,
    decisions_in_view,
    errors_in_view,
    jobs,
    keep_marks,
    live_preview,
    object_as_ground,
    recolour_errors,
    refine_ground,
    render,
)
from icymoon.operators.evaluate import find_rendered_pairs_in_steps
from icymoon.operators.import_ground import GroundOperator
from icymoon.operators.session import session
from icymoon.operators.settled_steps import settle
from icymoon.settings import preset_files
from icymoon.settings.blender import scene_properties
from icymoon.settings.topics.scene import Settings
from icymoon.support.steps import Outcome, Steps, advance, call

SCENES = "europa_rough_ice", "enceladus_block_field"
_SHOWN = 4
_SLIDER_STEPS = 12
#: Vertices per side of an object that becomes the ground: a million triangles, for which no one is asked.
_OBJECT_SIDE = 701


@dataclass
class Pieces:
    """Pieces of an action: their milliseconds of the processor and where each ended."""

    found: list[tuple[float, str]] = field(default_factory=list)

    def run(self, steps: Steps[Any]) -> Any:
        """Run work to its end, and note its pieces; returns its result."""
        outcome = Outcome()
        while True:
            began = time.thread_time()
            try:
                work = advance(steps, outcome)
            except StopIteration as end:
                self._note(began, "the end")
                return end.value
            self._note(began, _describe_place(steps))
            outcome = Outcome() if work is None else call(work)

    def run_at_once(self, work: Callable[[], object], name: str) -> None:
        """Run a function, and note it as one piece."""
        began = time.thread_time()
        work()
        self._note(began, name)

    def _note(self, began: float, name: str) -> None:
        self.found.append((1e3 * (time.thread_time() - began), name))

    def describe(self) -> str:
        """The number of pieces and the longest of them."""
        longest = sorted(self.found, reverse=True)[:_SHOWN]
        return f"{len(self.found):3d} pieces  " + ", ".join(f"{ms:.0f} ms {name}" for ms, name in longest)


def _describe_place(steps: Steps[Any]) -> str:
    """The file and line of the innermost generator that paused."""
    inner: Any = steps
    while isinstance(inner.gi_yieldfrom, GeneratorType):
        inner = inner.gi_yieldfrom
    code = inner.gi_code
    return f"{Path(code.co_filename).stem}.{code.co_name}:{inner.gi_frame.f_lineno}"


def _settings(scene: bpy.types.Scene) -> Settings:
    return scene_properties.read_settings(scene.icymoon)


def _build(scene: bpy.types.Scene) -> Pieces:
    pieces = Pieces()
    pieces.run(build_in_pieces.build_in_pieces(scene.session_uid, _settings(scene)))
    pieces.run_at_once(bpy.context.view_layer.update, "Blender's update")
    return pieces


def _refine(scene: bpy.types.Scene) -> Pieces:
    pieces, settings = Pieces(), _settings(scene)
    job = refine_ground.start_building(settings)
    while job.poll():
        time.sleep(jobs.INTERVAL_S)
    pieces.run(refine_ground._show_refined(scene.session_uid, settings, job))
    pieces.run_at_once(bpy.context.view_layer.update, "Blender's update")
    job.close()
    pieces.run(keep_marks._keep_marks(scene.session_uid))
    return pieces


def _slide(scene: bpy.types.Scene, topic: str, key: str, first: float, last: float) -> Pieces:
    pieces = Pieces()
    for number, value in enumerate(np.linspace(first, last, _SLIDER_STEPS)):
        setattr(getattr(scene.icymoon, topic), key, float(value))
        pieces.run_at_once(lambda: live_preview.update_scene(scene), f"step {number}")
        pieces.run_at_once(bpy.context.view_layer.update, f"Blender's update of step {number}")
    return pieces


def _prepare_render(scene: bpy.types.Scene) -> Pieces:
    pieces = Pieces()
    pieces.run(render.show_rendered_scene(scene.session_uid, _settings(scene)))
    return pieces


def _prepare_evaluation(scene: bpy.types.Scene) -> Pieces:
    pieces, settings = Pieces(), _settings(scene)
    pieces.run(settle(lambda: find_rendered_pairs_in_steps(scene.session_uid, settings)))
    return pieces


def _run_operator(kind: Any, **options: object) -> Pieces:
    """The pieces of an operator that works in pieces."""
    pieces = Pieces()
    operator = SimpleNamespace(report=lambda *_: None, **options)
    pieces.run(kind.make_steps(operator, bpy.context, lambda *_: None))
    pieces.run_at_once(bpy.context.view_layer.update, "Blender's update")
    return pieces


def _list_actions(scene: bpy.types.Scene) -> Iterator[tuple[str, Pieces]]:
    """Each action with its pieces, in the order of a user."""
    yield "build", _build(scene)
    yield "fine ground", _refine(scene)
    yield "slider of the ground", _slide(scene, "terrain", "rms_slope_deg", 20.0, 25.0)
    yield "slider of the Sun", _slide(scene, "light", "sun_elevation_deg", 20.0, 30.0)
    yield "slider of the surface", _slide(scene, "surface", "albedo", 0.7, 0.8)
    yield "build again", _build(scene)
    yield "fine ground again", _refine(scene)
    yield "slider of the Sun on fine ground", _slide(scene, "light", "sun_elevation_deg", 20.0, 30.0)
    yield "render", _prepare_render(scene)
    bpy.ops.icymoon.render_pair()
    yield "evaluate", _prepare_evaluation(scene)
    bpy.ops.icymoon.evaluate()
    yield "paint errors", _run_operator(errors_in_view.ICYMOON_OT_paint_errors, method="bm")
    yield "range of the errors", _slide_range(scene)
    pieces = Pieces()
    pieces.run_at_once(bpy.ops.icymoon.hide_surface, "hide")
    yield "remove errors", pieces
    bpy.ops.icymoon.decide()
    if bpy.ops.icymoon.paint_decisions.poll():
        yield "paint decisions", _run_operator(decisions_in_view.ICYMOON_OT_paint_decisions, method="bm", map="SLOPE")
    yield "selected object as ground", _build_on_object(scene)


class _GroundOperator(object_as_ground.SelectedMeshOperator, GroundOperator):
    """Use Selected Object as Ground, as Blender holds it after ``invoke``."""

    make_source = object_as_ground.ICYMOON_OT_object_as_ground.make_source

    def __init__(self, scene: bpy.types.Scene) -> None:
        self._scene_uid = scene.session_uid

    def report(self, kind: set[str], message: str, /) -> None:
        """Say nothing."""


def _build_on_object(scene: bpy.types.Scene) -> Pieces:
    """Build on a selected object of ``_OBJECT_SIDE`` vertices per side."""
    at = np.linspace(-6.0, 6.0, _OBJECT_SIDE)
    x, y = np.meshgrid(at, at)
    first = np.arange(_OBJECT_SIDE * (_OBJECT_SIDE - 1)).reshape(-1, _OBJECT_SIDE)[:, :-1].reshape(-1, 1)
    faces = (first + np.array([0, 1, _OBJECT_SIDE + 1, _OBJECT_SIDE])).astype(np.int32)
    mesh = build_mesh_from_arrays("Hill", np.stack([x, y, 0.1 * np.sin(3 * x)], axis=-1).reshape(-1, 3), faces)
    item = bpy.data.objects.new("Hill", mesh)
    scene.collection.objects.link(item)
    bpy.context.view_layer.objects.active = item
    item.select_set(True)
    bpy.context.view_layer.update()
    pieces = Pieces()
    pieces.run(_GroundOperator(scene).make_steps(bpy.context))
    pieces.run_at_once(bpy.context.view_layer.update, "Blender's update")
    return pieces


def _slide_range(scene: bpy.types.Scene) -> Pieces:
    """The pieces in which colours follow the range of the errors, as in a window."""
    pieces = Pieces()
    pieces.run(recolour_errors._recolour(scene.session_uid))
    pieces.run_at_once(bpy.context.view_layer.update, "Blender's update")
    return pieces


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenes", nargs="*", default=SCENES, help="names of presets of scenes")


def main(options: argparse.Namespace) -> None:
    """Print a line for each action on each scene."""
    start_blender()
    for name in options.scenes:
        scene = open_empty_file()
        session.reset()
        scene_properties.write_settings(scene.icymoon, preset_files.load_preset(f"scenes/{name}"))
        with scratch() as folder:
            scene.icymoon.dataset.folder, scene.icymoon.dataset.methods = str(folder), "bm"
            scene.icymoon.quality.samples = 1
            print(name, flush=True)
            for action, pieces in _list_actions(scene):
                print(f"  {action:32} {pieces.describe()}", flush=True)
