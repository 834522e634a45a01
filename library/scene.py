"""A scene: settings, and arrays or functions of a program's own; renders its pairs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from ..render.pairs.pair_folder import is_complete, read_unchanged_pair
from ..render.plans.planned_pair import expand_headings
from ..render.workers.job_commands import resolve_dataset_folder
from ..settings import description, user_files
from ..settings.toml_text import to_toml
from ..settings.topics.scene import Settings
from ..support.errors import IcyMoonError
from .inputs import Field, Input, make_albedo_input, make_heights_input, make_mask_input, make_rocks_input
from .rendered_pair import RenderedPair, read_settings
from .renderers import MessageReceiver, Renderer, default_renderer, ignore_message, issue_warnings

#: Largest number of settings that the text of a scene shows.
_MAX_SHOWN_SETTINGS = 8


def _has_stated(changes: Mapping[str, Any], name: str) -> bool:
    topic, _, key = name.partition(".")
    return key in changes.get(topic, {})


class Scene:
    """A scene to render: complete settings, made from presets and changes. A scene never changes.

    ``Scene("europa_rough_ice", "qualities/draft", rig={"width_px": 640})`` takes the presets (names, or paths of TOML
    files), the later over the earlier, then the changes by topic. Settings that no preset states have their defaults.
    Raises IcyMoonError for an unknown name, with the nearest one, and for values of a wrong type or out of range.
    """

    def __init__(self, *presets: str | Path, **changes: Mapping[str, Any]) -> None:
        self._settings = description.merged(description.defaults(), read_settings(presets, changes))
        self._inputs: dict[str, Input] = {}
        self._title = " + ".join(str(preset) for preset in presets) or "defaults"

    def _make_changed(self, changes: Settings, inputs: Mapping[str, Input], title: str = "") -> Scene:
        made = object.__new__(Scene)
        made._settings = description.merged(self._settings, changes)
        kept = {name: each for name, each in self._inputs.items() if not _has_stated(changes, name)}
        made._inputs = {**kept, **inputs}
        made._title = " + ".join(filter(None, (self._title, title)))
        return made

    @property
    def settings(self) -> Settings:
        """A copy of the complete settings of the scene: ``scene.settings.rig.width_px``."""
        return description.merged(self._settings)

    @property
    def changes(self) -> dict[str, Any]:
        """The values that differ from their defaults, by setting (``topic.key``)."""
        changed = description.changed(self._settings, description.defaults())
        return {f"{topic}.{key}": value for topic, values in changed.items() for key, value in values.items()}

    def __repr__(self) -> str:
        rig = self._settings.rig
        own = "".join(f", {each.text}" for each in self._inputs.values())
        return f"<Scene {self._title}: {rig.width_px} x {rig.height_px} px, baseline {rig.baseline_m:g} m{own}>"

    def to_toml(self) -> str:
        """Return the settings as text of a TOML file, for ``icymoon render --settings``. It lacks the arrays of
        ``with_heights``, ``with_albedo``, ``with_rocks`` and ``with_mask``.
        """
        return to_toml(self._settings)

    def change(self, *presets: str | Path, **changes: Mapping[str, Any]) -> Scene:
        """Return a copy of this scene with presets and changes over it. Raises IcyMoonError as ``Scene`` does."""
        stated = read_settings(presets, changes)
        names = [
            *map(str, presets),
            *(
                f"{topic}.{key}={value}"
                for topic, values in changes.items()
                if isinstance(values, Mapping)
                for key, value in values.items()
            ),
        ]
        shown = names if len(names) <= _MAX_SHOWN_SETTINGS else [*names[:_MAX_SHOWN_SETTINGS], "…"]
        return self._make_changed(stated, {}, ", ".join(shown))

    def with_heights(self, heights: Field, *, metres_per_pixel: float | None = None, detail: bool = False) -> Scene:
        """Return a copy of this scene with your own ground.

        ``heights`` is a function or an array. A function f(x_m, y_m) -> z_m takes arrays of east and north coordinates,
        and is sampled at the vertices of the patch of ``terrain.size_m``, ``terrain.resolution`` along each side. An
        array (rows, columns) is in metres, north first, and its outermost values are on the edges of the patch. With
        ``metres_per_pixel`` the patch is as large as the array. Between the values, the ground is bilinear. With
        ``detail``, the roughness of the ``terrain`` settings is added below the spacing. Raises IcyMoonError for an
        array of another shape and for heights that are not finite.
        """
        terrain = self._settings.terrain
        given, stated = make_heights_input(heights, terrain.size_m, int(terrain.resolution), metres_per_pixel)
        stated["source"]["detail"] = detail
        return self._make_changed(description.check(stated, "heights"), {given.setting: given})

    def with_albedo(self, albedo: Field, *, resolution: int = 512) -> Scene:
        """Return a copy of this scene with your own albedo over the whole patch of ground.

        ``albedo`` is a function f(x_m, y_m) of arrays, sampled at ``resolution`` x ``resolution`` points, or an array
        (rows, columns) or (rows, columns, 3) of numbers from 0 to 1, north first. Other variations of the albedo are
        turned off. Beyond the patch the outermost values are repeated. Raises IcyMoonError for values outside 0 to 1.
        """
        given, stated = make_albedo_input(albedo, self._settings.terrain.size_m, resolution)
        return self._make_changed(description.check(stated, "albedo"), {given.setting: given})

    def with_rocks(self, rocks: ArrayLike) -> Scene:
        """Return a copy of this scene with your own rocks: an array (n, 3) of east, north and diameter in metres.

        Their shapes, tilt and burial follow the ``rocks`` settings; each rests on the ground. Rocks off the ground are
        left out, with a warning. Raises IcyMoonError for an array of another shape, for numbers that are not finite,
        and for diameters that are not above 0.
        """
        given, stated = make_rocks_input(rocks, self._settings.terrain.size_m)
        return self._make_changed(description.check(stated, "rocks"), {given.setting: given})

    def with_mask(self, of: str, mask: Field, *, resolution: int = 512) -> Scene:
        """Return a copy of this scene with your own mask of rocks, dirt or frost; ``of`` is ``rocks``, ``dirt`` or
        ``frost``.

        ``mask`` is a function f(x_m, y_m) of arrays, sampled at ``resolution`` x ``resolution`` points of the patch, or
        an array (rows, columns), north first. At 0 there is nothing, at 1 as much as without the mask. For rocks, it is
        the probability that a rock remains, at its old position. Beyond the patch the outermost values are repeated.
        Raises IcyMoonError for values outside 0 to 1.
        """
        given = make_mask_input(of, mask, self._settings.terrain.size_m, resolution)
        return self._make_changed(description.check({}, "mask"), {given.setting: given})

    def stored(self, dataset: str | Path) -> Settings:
        """Write the program's arrays to the folder ``inputs`` of the data set; return the complete settings."""
        folder = Path(dataset).absolute()
        paths: dict[str, dict[str, str]] = {}
        for name, given in self._inputs.items():
            topic, _, key = name.partition(".")
            paths.setdefault(topic, {})[key] = str(given.store(folder))
        return description.merged(self._settings, paths)

    def render(
        self,
        dataset: str | Path | None = None,
        *,
        renderer: Renderer | None = None,
        again: bool = False,
        on_event: MessageReceiver = ignore_message,
    ) -> RenderedPair:
        """Render this scene into the folder of a data set, or read its pair if the folder already contains it.

        ``dataset`` is by default the folder that ``dataset.folder`` states. ``renderer`` is by default a ``Worker``
        that all scenes share; its warnings are Python warnings. With ``again`` an existing pair is rendered again.
        ``on_event`` receives the messages of the render as dictionaries: ``progress`` with ``fraction``, ``warning``
        with ``message``. Raises IcyMoonError if the scene cannot be built or rendered, and if ``dataset.headings`` asks
        for several pairs.
        """
        if (count := self._settings.dataset.headings) != 1:
            raise IcyMoonError(f"dataset.headings is {count}, so this scene has {count} pairs; use render_all.")
        return self.render_all(dataset, renderer=renderer, again=again, on_event=on_event)[0]

    def render_all(
        self,
        dataset: str | Path | None = None,
        *,
        renderer: Renderer | None = None,
        again: bool = False,
        on_event: MessageReceiver = ignore_message,
    ) -> list[RenderedPair]:
        """Render the pairs of this scene, one for each of ``dataset.headings``; see ``render``."""
        folder = (
            Path(dataset).absolute() if dataset is not None else resolve_dataset_folder(self._settings.dataset.folder)
        )
        settings = self.stored(folder)
        folders = [pair.folder(folder) for pair in expand_headings(settings, user_files.hash_content(settings))]
        if again or not all(map(is_complete, folders)):
            folders = (renderer or default_renderer()).render(settings, folder, again, issue_warnings(on_event))
        return [RenderedPair(read_unchanged_pair(each)) for each in folders]
