"""Trial of a plug-in's landform on many points: a list of checks, each with its fix."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from ....plugins.common_checks import Check, check_call, check_fault, check_making
from ....plugins.installed import Plugin
from ....plugins.landforms import PluginLandform, read_landform
from ....support.arrays import Array

#: Side of the trial's patch in metres.
_TRIAL_SIZE_M = 20.0
#: Number of rows of points; it differs from the columns, so that an exchange of the axes shows.
_TRIAL_ROWS = 61
#: Number of columns of points.
_TRIAL_COLUMNS = 83
_SEED = 12345
#: Largest difference by rounding; vector instructions may round by the place of a point in an array.
_ROUNDING_M = 1e-9


def check_landform(plugin: Plugin) -> Iterator[Check]:
    """Yield checks of a landform at its defaults, with its size at 1 or its largest, and at both ends of each
    setting.
    """
    first, landform = check_making(
        "it has height(x, y, settings), and its settings are declared", lambda: read_landform(plugin)
    )
    yield first
    if landform is None:
        return
    size = landform.settings[0]
    most = min(size.maximum, 1.0) if isinstance(size.default, float) else min(int(size.maximum), 1)
    settings = {number.key: number.default for number in landform.settings} | {size.key: most}
    x = np.linspace(-_TRIAL_SIZE_M / 2, _TRIAL_SIZE_M / 2, _TRIAL_COLUMNS)[None, :]
    y = np.linspace(-_TRIAL_SIZE_M / 2, _TRIAL_SIZE_M / 2, _TRIAL_ROWS)[:, None]

    def run(x: Array = x, y: Array = y, seed: int = _SEED, **changes: float) -> Array:
        return landform.heights(x, y, landform.make_plugin_settings(settings | changes, seed))

    ran, heights = check_making("it returns a height for every point, in metres", run)
    yield ran
    if heights is None:
        return
    yield Check(
        f"it makes relief where {size.key} is {most:g}",
        ""
        if np.ptp(heights) > 0
        else f"{plugin.title} is level where {size.key} is {most:g}; make its heights depend on it.",
    )
    yield from _check_places(plugin, run, x, y, heights)
    yield check_call("another seed raises no error", run, seed=_SEED + 1)
    yield check_call("points far away raise no error", run, x * 1000.0, y * 1000.0)
    yield check_fault("it states its smallest length", lambda: _describe_finest(landform, settings))
    for number in landform.settings:
        for value in (number.minimum, number.maximum):
            whole = not isinstance(number.default, float)
            changes = {number.key: int(value) if whole else float(value)}
            yield check_call(f"{number.key}={value:g} raises no error", run, **changes)


def _check_places(plugin: Plugin, run: Callable[..., Array], x: Array, y: Array, heights: Array) -> Iterator[Check]:
    """Yield checks that the height at a point does not depend on the other points."""
    yield check_fault(
        "the same points have the same heights again",
        lambda: _describe_difference(
            plugin,
            run(),
            heights,
            'gave other heights for the same points; take random numbers from settings["seed"] only',
        ),
    )
    shuffle = np.random.default_rng(0)
    order = shuffle.permutation(heights.size)
    flat_x, flat_y = (np.broadcast_to(values, heights.shape).ravel()[order] for values in (x, y))
    wrong = (
        "gave other heights for the same points in another order or number; compute each from its own x and y "
        "alone, as the ground is made in tiles"
    )
    yield check_fault(
        "a height depends on its own place alone, not on the other points",
        lambda: _describe_difference(plugin, run(flat_x, flat_y), heights.ravel()[order], wrong)
        or _describe_difference(plugin, run(x[:, :7], y[5:9]), heights[5:9, :7], wrong)
        or _describe_difference(plugin, run(x[:, :1], y[:1]), heights[:1, :1], wrong),
    )


def _describe_difference(plugin: Plugin, heights: Array, expected: Array, what: str) -> str:
    allowed = _ROUNDING_M * max(1.0, float(np.abs(expected).max()))
    return "" if np.allclose(heights, expected, rtol=0.0, atol=allowed) else f"{plugin.title} {what}."


def _describe_finest(landform: PluginLandform, settings: Mapping[str, Any]) -> str:
    if landform.finest is None:
        return (
            f"{landform.plugin.title} has no finest_m(settings); write one that returns its smallest length in "
            "metres, or a mesh that is too coarse for it shows noise."
        )
    landform.finest_m(landform.make_plugin_settings(settings, _SEED))
    return ""
