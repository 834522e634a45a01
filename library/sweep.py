"""Renders all combinations of varied settings and inputs of a scene. A second run continues where the first run
stopped.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from .rendered_pair import RenderedPair
from .renderers import MessageReceiver, Renderer, ignore_message
from .scene import Scene

#: Inputs that can vary besides settings, and the method of ``Scene`` that takes each.
_ARRAY_METHODS: dict[str, Callable[[Scene, Any], Scene]] = {
    "heights": Scene.with_heights,
    "albedo": Scene.with_albedo,
    "rocks": Scene.with_rocks,
}


@dataclass(frozen=True)
class SweepPoint:
    """One combination of varied values: ``values`` by setting or input, its ``scene`` and its ``pair``."""

    values: dict[str, Any]
    scene: Scene
    pair: RenderedPair

    def __repr__(self) -> str:
        return f"<SweepPoint {_format_values(self.values)}: {self.pair.id}>"


class Sweep:
    """All combinations of varied values. Iterating renders missing pairs and returns the pairs one after the other.

    ``vary`` has a sequence of values for each varied setting, by its name, such as ``{"light.sun_elevation_deg": [5,
    20]}``. ``"heights"``, ``"albedo"`` and ``"rocks"`` have functions or arrays by names of yours, such as
    ``{"heights": {"flat": f, "rough": g}}``, see ``Scene``. The first entry varies slowest, so put values there whose
    change takes longest, such as heights. Finished pairs are never rendered again: a second run of the same program
    returns them immediately and continues where the first one stopped. Raises IcyMoonError for unknown settings and
    impossible values.
    """

    def __init__(
        self,
        scene: Scene,
        dataset: str | Path,
        vary: Mapping[str, Sequence[Any] | Mapping[str, Any]],
        *,
        renderer: Renderer | None = None,
        on_event: MessageReceiver = ignore_message,
    ) -> None:
        self.scene, self.dataset = scene, Path(dataset).absolute()
        self._renderer, self._hear = renderer, on_event
        self._axes = {name: _list_choices(name, values) for name, values in vary.items()}
        self._scenes = [self._make_scene(chosen) for chosen in itertools.product(*self._axes.values())]

    def _make_scene(self, chosen: tuple[tuple[Any, Any], ...]) -> tuple[dict[str, Any], Scene]:
        values = {name: label for name, (label, _) in zip(self._axes, chosen, strict=True)}
        scene = self.scene
        for name, (_, value) in zip(self._axes, chosen, strict=True):
            if name in _ARRAY_METHODS:
                scene = _ARRAY_METHODS[name](scene, value)
            else:
                topic, _, key = name.partition(".")
                changes: Any = {topic: {key: value}}  # whose names are known only when the program runs
                scene = scene.change(**changes)
        return values, scene

    def __len__(self) -> int:
        return len(self._scenes)

    def __repr__(self) -> str:
        axes = " x ".join(f"{len(values)} {name}" for name, values in self._axes.items())
        return f"<Sweep of {format_count(len(self), 'pair')}: {axes}, in {self.dataset}>"

    def __iter__(self) -> Iterator[SweepPoint]:
        """Yield the points in order, each rendered first if missing. Raises IcyMoonError that names the point."""
        for values, scene in self._scenes:
            try:
                pair = scene.render(self.dataset, renderer=self._renderer, on_event=self._hear)
            except IcyMoonError as error:
                raise IcyMoonError(f"Sweep at {_format_values(values)}: {error}") from error
            yield SweepPoint(values, scene, pair)


def _list_choices(name: str, values: Sequence[Any] | Mapping[str, Any]) -> list[tuple[Any, Any]]:
    """List (label, value) for each varied value."""
    if name in _ARRAY_METHODS:
        if not isinstance(values, Mapping):
            raise IcyMoonError(f"The {name} of a sweep need names, such as {{{name!r}: {{'mine': f}}}}.")
        return list(values.items())
    if isinstance(values, Mapping | str) or not len(values):
        raise IcyMoonError(f"{name} varies over {values!r}; give a list of values.")
    return [(value, value) for value in values]


def _format_values(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in values.items())
