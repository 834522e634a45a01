"""Trying a plug-in of the evaluator on a pair whose truth is known, as a list of checks with what to correct."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from ..plugins.check import Check, check_of
from ..plugins.installed import Plugin
from .matchers.plug_in import PluginMatcher

#: The images of the trial, odd on purpose; the disparity grows by this much from row to row.
_HEIGHT, _WIDTH, _FARTHEST_PX, _ROW_PX = 119, 161, 9.0, 0.1
#: A matcher that measures is right to this, px, in most of its pixels; the wrong sign or unit is off by ten times that.
_RIGHT_PX = 1.0
_LEAST_PX, _COUNT = 0, 32


def textured_pair(height: int = _HEIGHT, width: int = _WIDTH, colour: bool = False
                  ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two uint8 images of a textured, tilted plane, (H, W) or (H, W, 3), and the true disparity, float64 (H, W) px."""
    x, y = np.arange(width)[None, :], np.arange(height)[:, None]
    disparity = np.broadcast_to(_FARTHEST_PX + _ROW_PX * y, (height, width)) * min(1.0, width / _WIDTH)
    left, right = (np.asarray(127.5 + 100 * _texture(x + shift, y), np.uint8) for shift in (0.0, disparity))
    if colour:
        left, right = (np.stack([image, image // 2, image // 4], axis=-1) for image in (left, right))
    return left, right, disparity


def _texture(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Waves of 4 to 30 px in all directions, between -1 and 1."""
    total = np.zeros(np.broadcast_shapes(x.shape, y.shape))
    for k, wavelength in enumerate(np.geomspace(4.0, 30.0, 24)):
        angle = 2.399963 * k  # the golden angle: no two waves run alike
        total += np.sin(2 * np.pi / wavelength * (x * np.cos(angle) + y * np.sin(angle)) + angle**2)
    return np.clip(total / 7.0, -1.0, 1.0)


def check_matcher(plugin: Plugin) -> Iterator[Check]:
    """Try a matcher on images of several sizes and with the ends of its options."""
    made: list[PluginMatcher] = []
    yield (first := check_of("it has match(left, right, context), and its options are declared",
                             lambda: made.append(PluginMatcher(plugin))))
    if first.fault:
        return
    matcher = made[0]
    defaults = {option.key: option.default for option in matcher.OPTIONS}
    left, right, truth = textured_pair(colour=matcher.COLOUR)

    def run(left: np.ndarray = left, right: np.ndarray = right, count: int = _COUNT, **options: Any) -> np.ndarray:
        given = defaults | {"min_disparity": _LEAST_PX, "disparities": count} | options
        return matcher.compute(left, right, given, None).disparity

    found: list[np.ndarray] = []
    yield (ran := check_of("it returns a disparity for each pixel, in float", lambda: found.append(run())))
    if ran.fault:
        return
    yield Check("it measures the plane of the trial, in px and with the right sign", _fault(plugin, found[0], truth))
    outside = int(((found[0] < _LEAST_PX - 1) | (found[0] > _LEAST_PX + _COUNT)).sum())
    yield Check("it keeps to the disparities that are searched", "" if not outside else
                f"{plugin.title} returned {outside} disparities outside {_LEAST_PX} to {_LEAST_PX + _COUNT - 1} px; "
                "search context.least_px to context.most_px, or return NaN.")
    yield check_of("the same images give the same result", lambda: None if np.array_equal(
        found[0], run(), equal_nan=True) else f"{plugin.title} gave two results for the same images; draw its random "
                   "numbers from a fixed seed.")
    flat = np.full_like(left, 100)
    yield check_of("images without texture are no error", lambda: _nothing(run(flat, flat)))
    small, other, _ = textured_pair(24, 33, matcher.COLOUR)
    yield check_of("small images are no error", lambda: _nothing(run(small, other)))
    yield check_of("a range as wide as the image is no error", lambda: _nothing(run(small, other, 48)))
    for option in matcher.OPTIONS:
        if option.key in ("disparities", "min_disparity") or (
                isinstance(option.default, str) and not option.choices):
            continue
        for value in option.choices or (option.minimum, option.maximum):
            yield check_of(f"{option.key}={value} is no error", partial(_try, run, option.key, value))


def _fault(plugin: Plugin, found: np.ndarray, truth: np.ndarray) -> str:
    """What is wrong with the disparities of the trial."""
    def share_right(values: np.ndarray) -> float:
        known = np.isfinite(values)
        return float((np.abs(values - truth)[known] < _RIGHT_PX).mean()) if known.any() else 0.0

    with np.errstate(divide="ignore"):
        guesses: dict[str, Callable[[], np.ndarray]] = {
            "": lambda: found,
            "they have the wrong sign: return left column minus right column": lambda: -found,
            "they are 16 times too large: OpenCV counts sixteenths of a px": lambda: found / 16,
            "they are normalised by the width: return px": lambda: found * found.shape[1],
            "they belong to the right image: return those of the left one": lambda: np.roll(found, 14, axis=1)}
        for words, guess in guesses.items():
            if share_right(guess()) > 0.5:
                return f"{plugin.title} returned disparities that are not those of the trial: {words}." if words else ""
    if not np.isfinite(found).any():
        return f"{plugin.title} measured nothing on well textured images; return disparities in px."
    return (f"{plugin.title} is wrong by more than {_RIGHT_PX:g} px in most of the pixels that it measured "
            f"({np.nanmedian(found):.3g} px in the median, {np.median(truth):.3g} px is right); check sign and unit, "
            "and return NaN where a match is not certain.")


def _try(run: Callable[..., Any], key: str, value: Any) -> None:
    run(**{key: value})


def _nothing(result: Any) -> None:
    """No fault, since it came back."""
