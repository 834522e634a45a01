"""Try a plug-in of the evaluator on a pair whose truth is known; the result is a list of checks with their
corrections.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from ..plugins.common_checks import Check, check_call, check_fault, check_making
from ..plugins.installed import Plugin
from ..settings.description import defaults
from ..support.arrays import Array
from ..support.files import hash_file
from ..support.temporary_folders import open_scratch_folder
from .export.plug_in import ExportedPair, PluginExport
from .matchers.plug_in import PluginMatcher
from .measure.metrics import is_usable
from .measure.plug_in import MeasuredMap, PluginMetric

#: Size of the trial's images, with odd sides on purpose; the disparity of the farthest row, px, and its growth per row,
#: px.
_HEIGHT, _WIDTH, _FARTHEST_PX, _ROW_PX = 119, 161, 9.0, 0.1
#: Largest error, px, of a working matcher in most of its pixels; a wrong sign or unit gives ten times this error.
_RIGHT_PX = 1.0
_MIN_PX, _COUNT = 0, 32
#: The camera of the trial.
_FOCAL_PX, _FOCAL_BASELINE_PX_M = 86.0, 21.5


def make_textured_pair(height: int = _HEIGHT, width: int = _WIDTH, colour: bool = False) -> tuple[Array, Array, Array]:
    """Make two uint8 images, (H, W) or (H, W, 3), of a textured, tilted plane, and their true disparity, float64 (H, W)
    px.
    """
    x, y = np.arange(width)[None, :], np.arange(height)[:, None]
    disparity = np.broadcast_to(_FARTHEST_PX + _ROW_PX * y, (height, width)) * min(1.0, width / _WIDTH)
    left, right = (np.asarray(127.5 + 100 * _make_texture(x + shift, y), np.uint8) for shift in (0.0, disparity))
    if colour:
        left, right = (np.stack([image, image // 2, image // 4], axis=-1) for image in (left, right))
    return left, right, disparity


def _make_texture(x: Array, y: Array) -> Array:
    """Sum waves of 4 to 30 px in all directions to values between -1 and 1."""
    total = np.zeros(np.broadcast_shapes(x.shape, y.shape))
    for k, wavelength in enumerate(np.geomspace(4.0, 30.0, 24)):
        angle = 2.399963 * k  # the golden angle: no two waves run alike
        total += np.sin(2 * np.pi / wavelength * (x * np.cos(angle) + y * np.sin(angle)) + angle**2)
    return np.clip(total / 7.0, -1.0, 1.0)


def check_matcher(plugin: Plugin) -> Iterator[Check]:
    """Try a matcher on images of several sizes and with the ends of its options."""
    first, matcher = check_making(
        "it has match(left, right, context), and its options are declared", lambda: PluginMatcher(plugin)
    )
    yield first
    if matcher is None:
        return
    defaults = {option.key: option.default for option in matcher.OPTIONS}
    left, right, truth = make_textured_pair(colour=matcher.COLOUR)

    def run(left: Array = left, right: Array = right, count: int = _COUNT, **options: object) -> Array:
        given = defaults | {"min_disparity": _MIN_PX, "disparities": count} | options
        result = matcher.compute(left, right, given, None)
        if result.confidence is not None:
            result.confidence.check(plugin.title, is_usable(result.disparity))
        return result.disparity

    ran, found = check_making("it returns a disparity for each pixel, in float", run)
    yield ran
    if found is None:
        return
    yield Check("it measures the plane of the trial, in px and with the right sign", _find_fault(plugin, found, truth))
    yield Check("it keeps to the disparities that are searched", _describe_outside(plugin, found))
    yield check_fault(
        "the same images give the same result",
        lambda: None
        if np.array_equal(found, run(), equal_nan=True)
        else f"{plugin.title} gave two results for the same images; draw its random numbers from a fixed seed.",
    )
    flat = np.full_like(left, 100)
    yield check_call("images without texture raise no error", run, flat, flat)
    small, other, _ = make_textured_pair(24, 33, matcher.COLOUR)
    yield check_call("small images raise no error", run, small, other)
    yield check_call("a range as wide as the image raises no error", run, small, other, 48)
    for option in matcher.OPTIONS:
        if option.key in ("disparities", "min_disparity") or (isinstance(option.default, str) and not option.choices):
            continue
        for value in option.choices or (option.minimum, option.maximum):
            yield check_call(f"{option.key}={value} raises no error", run, **{option.key: value})


def _find_fault(plugin: Plugin, found: Array, truth: Array) -> str:
    """Describe the fault of the plug-in's disparities in the trial in a sentence; return "" if they are right."""

    def share_right(values: Array) -> float:
        known = np.isfinite(values)
        return float((np.abs(values - truth)[known] < _RIGHT_PX).mean()) if known.any() else 0.0

    with np.errstate(divide="ignore"):
        guesses: dict[str, Callable[[], Array]] = {
            "": lambda: found,
            "they have the wrong sign: return left column minus right column": lambda: -found,
            "they are 16 times too large: OpenCV counts sixteenths of a px": lambda: found / 16,
            "they are normalised by the width: return px": lambda: found * found.shape[1],
            "they belong to the right image: return the disparities of the left one": lambda: np.roll(
                found, 14, axis=1
            ),
        }
        for words, guess in guesses.items():
            if share_right(guess()) > 0.5:
                return f"{plugin.title} returned disparities that differ from the trial's: {words}." if words else ""
    if not np.isfinite(found).any():
        return f"{plugin.title} measured nothing on well textured images; return disparities in px."
    return (
        f"{plugin.title} is wrong by more than {_RIGHT_PX:g} px in most of the pixels that it measured "
        f"({np.nanmedian(found):.3g} px in the median, {np.median(truth):.3g} px is right); check sign and unit, "
        "and return NaN where a match is not certain."
    )


def _describe_outside(plugin: Plugin, found: Array) -> str:
    count = int(((found < _MIN_PX - 1) | (found > _MIN_PX + _COUNT)).sum())
    return (
        f"{plugin.title} returned {count} disparities outside {_MIN_PX} to {_MIN_PX + _COUNT - 1} px; "
        "search context.least_px to context.most_px, or return NaN."
        if count
        else ""
    )


def check_metric(plugin: Plugin) -> Iterator[Check]:
    """Try a metric on a disparity map with gaps, one without an error, and one without a measurement."""
    first, metric = check_making("it has measure(found), and its unit is declared", lambda: PluginMetric(plugin))
    yield first
    if metric is None:
        return
    left, _, truth = make_textured_pair()
    rough = truth + np.where(np.arange(_WIDTH) % 7 < 3, 0.75, -0.25)
    rough[::5] = np.nan

    def run(disparity: Array, true: Array = truth) -> float | None:
        depth, true_depth = (_FOCAL_BASELINE_PX_M / values for values in (disparity, true))
        baseline_m = _FOCAL_BASELINE_PX_M / _FOCAL_PX
        images = disparity.copy(), depth, true.copy(), true_depth, np.isfinite(true), left
        return metric.measure(MeasuredMap(*images, _FOCAL_PX, baseline_m))

    ran, found = check_making("it returns a number", lambda: run(rough))
    yield ran
    if ran.fault:
        return
    yield Check(
        "it is defined for a map with errors and gaps",
        ""
        if found is not None
        else f"{plugin.title} returned NaN or infinity for a map with errors and gaps; leave out NaN.",
    )
    yield check_fault(
        "the same map gives the same number",
        lambda: None
        if run(rough) == found
        else f"{plugin.title} gave two numbers for the same map; draw its random numbers from a fixed seed.",
    )
    yield check_call("a map that is the truth raises no error", run, truth)
    yield check_call("a map without a measurement raises no error", run, np.full_like(truth, np.nan))
    sky = np.where(np.arange(_HEIGHT)[:, None] < 40, np.nan, truth)
    yield check_call("sky without a truth raises no error", run, rough, sky)
    yield check_call("a pair without any truth raises no error", run, rough, np.full_like(truth, np.nan))


def check_export(plugin: Plugin) -> Iterator[Check]:
    """Try an export on a pair of a grey camera and one of a colour camera, the latter without labels."""
    first, exporter = check_making(
        "it has write_pair(pair, folder), write_all or write_folders", lambda: PluginExport(plugin)
    )
    yield first
    if exporter is None:
        return
    yield (ready := check_call("it can write here", exporter.check))
    if ready.fault or exporter.reads_folders:  # no pair folder is made here
        return
    with open_scratch_folder() as folder:
        written: dict[str, dict[str, str]] = {}

        def run(out: str, colour: bool) -> str:
            pair = _make_exported_pair(colour)
            if exporter.writes_all:
                exporter.write_all(lambda write: write(pair), folder / out)
            else:
                exporter.write_pair(pair, pair.name, folder / out)
            files = (path for path in (folder / out).rglob("*") if path.is_file())
            written[out] = {path.relative_to(folder / out).as_posix(): hash_file(path) for path in files}
            return ""

        yield (ran := check_fault("it writes a pair of a grey camera", partial(run, "first", False)))
        if ran.fault:
            return
        yield check_fault(
            "the same pair gives the same files",
            lambda: run("second", False)
            or (
                ""
                if written["first"] == written["second"]
                else f"{plugin.title} wrote other bytes for the same pair; leave out the time and "
                "other things that change."
            ),
        )
        yield check_fault("it writes a pair of a colour camera, without labels", partial(run, "colour", True))
        if exporter.finishes:
            yield check_call("finish(names, folder) raises no error", exporter.finish, ["first"], folder / "first")


def _make_exported_pair(colour: bool) -> ExportedPair:
    left, right, disparity = make_textured_pair(colour=colour)
    disparity = np.where(np.arange(_HEIGHT)[:, None] < 10, np.nan, disparity)
    depth, seen = _FOCAL_BASELINE_PX_M / disparity, np.isfinite(disparity)
    light = np.repeat(left[..., None], 3, axis=-1) if left.ndim == 2 else left
    labels = None if colour else seen.astype(np.int32)
    settings = {topic: dict(values) for topic, values in defaults().items()}
    return ExportedPair(
        "trial",
        left.astype(np.uint16) << 4,
        right.astype(np.uint16) << 4,
        12,
        light.astype(np.float32),
        light.astype(np.float32),
        depth,
        depth,
        disparity,
        disparity,
        seen,
        seen,
        labels,
        labels,
        _FOCAL_PX,
        _WIDTH / 2,
        _HEIGHT / 2,
        _FOCAL_BASELINE_PX_M / _FOCAL_PX,
        settings,
    )
