"""Provides the scene for each pair: one built scene, or a scene built from each pair's settings."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, closing
from types import TracebackType
from typing import Self

import bpy

from ..nodes import eyes_above_ground
from ..nodes.build_scene import Built
from ..nodes.change_scene import adapt_scene
from ..nodes.ground.user_ground import warn_of_cost
from ..physics import scene_checks
from ..physics.camera.blur import describe_blur_identity
from ..physics.mesh.finer_in_view import find_undisplaced_spacing_m
from ..settings import rebuilt_parts
from ..settings.pair_ids import make_pair_id
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from . import cycles_settings
from .plans.planned_pair import PlannedPair
from .ray_stage import SceneRays
from .render_pair import check_camera, open_render_scene

#: The scene of a pair: the built objects, the scene to render, and the seconds of the build.
PreparedScene = tuple[Built, bpy.types.Scene, float]


class FixedScene:
    """A built scene that is rendered as it is, with all changes of the user."""

    def __init__(self, built: Built, frame: int, seconds_build: float) -> None:
        """Use a built scene. Raises IcyMoonError if it shows a preview, or if its camera was changed by hand, see
        ``check_camera``."""
        if built.preview:
            raise IcyMoonError("The scene shows a preview; press Build Scene and render again.")
        check_camera(built)
        self._built, self._frame, self._seconds = built, frame, seconds_build
        self._held = ExitStack()
        self._scene: bpy.types.Scene | None = None
        self.rays: SceneRays | None = None

    def __enter__(self) -> Self:
        self._scene = self._held.enter_context(open_render_scene(self._built, self._frame))
        self.rays = self._held.enter_context(
            closing(SceneRays(self._scene, find_undisplaced_spacing_m(self._built.settings.surface)))
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._held.close()

    def prepare(self, planned: PlannedPair) -> PreparedScene:
        """Prepare the scene for a pair, and return it."""
        assert self._scene is not None
        cycles_settings.check_possible(planned.settings.quality)
        _raise_reasons(
            [
                *scene_checks.find_reasons_in_settings(planned.settings),
                *eyes_above_ground.find_reasons(self._built, planned.turn_deg, self._scene),
            ]
        )
        return self._built, self._scene, self._seconds


class ScenesFromSettings:
    """Scenes built from settings. Each scene reuses parts of the one before."""

    def __init__(self, warn: Callable[[str], None], extra: str = "") -> None:
        """Start without a scene. ``warn`` receives each warning once; ``extra`` counts in the pairs' ids beside their
        settings."""
        self._warn, self._extra = warn, extra
        self._warned: set[str] = set()
        self._built: Built | None = None
        self._scene: bpy.types.Scene | None = None
        self.rays: SceneRays | None = None
        self._held = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._held.close()

    def prepare(self, planned: PlannedPair) -> PreparedScene:
        """Prepare the scene for a pair, and return it. Raises IcyMoonError if the scene cannot be built; the next one
        may succeed."""
        start = time.perf_counter()
        before, self._built = self._built, None
        cycles_settings.check_possible(planned.settings.quality)
        _raise_reasons(scene_checks.find_reasons_without_file(planned.settings))
        scene_checks.refuse_scene(planned.settings)
        shared = before is not None and _same_scene_and_light(before.settings, planned.settings)
        if not shared:  # the data that Cycles keeps is useless now
            self._held.close()
            self._warn_once(warn_of_cost(planned.settings))
        built, kept = adapt_scene(before, planned.settings)
        self._warn_once(built.warnings)
        _check_id(planned, built, self._extra)
        if not shared or not kept:
            self._held.close()
            self._scene = self._held.enter_context(open_render_scene(built, bpy.context.scene.frame_current))
            self.rays = self._held.enter_context(
                closing(SceneRays(self._scene, find_undisplaced_spacing_m(built.settings.surface)))
            )
        assert self._scene is not None
        self._built = built
        # A scene that comes and goes would make Cycles build its tree of triangles again.
        _raise_reasons(eyes_above_ground.find_reasons_when_built(built, self._scene))
        return built, self._scene, time.perf_counter() - start

    def _warn_once(self, warnings: list[str] | tuple[str, ...]) -> None:
        for warning in warnings:
            if warning not in self._warned:
                self._warned.add(warning)
                self._warn(warning)


def _raise_reasons(reasons: Iterable[str]) -> None:
    """Raise IcyMoonError with all reasons, if there are any."""
    if text := " ".join(reasons):
        raise IcyMoonError(text)


def _same_scene_and_light(one: Settings, other: Settings) -> bool:
    """Return whether two settings differ only in camera, sampling, response and run."""
    return all(
        part(one) == part(other)
        for part in (
            rebuilt_parts.select_scene,
            rebuilt_parts.select_appearance,
            rebuilt_parts.select_light,
            rebuilt_parts.select_lander,
        )
    )


def _check_id(planned: PlannedPair, built: Built, extra: str) -> None:
    if make_pair_id(planned.settings, built.extra + extra + describe_blur_identity(planned.settings)) != planned.id:
        why = (
            "a file that its settings name has changed since the plan"
            if built.content
            else "nodes stand in for OSL here (set hapke.backend to NODES), or another version planned it"
        )
        raise IcyMoonError(f"Pair {planned.id} would differ from its plan: {why}; plan the data set again.")
