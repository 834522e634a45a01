"""Evaluates pairs with Icy Moon's matchers and with your own functions."""

from __future__ import annotations

import inspect
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..settings.topics.declaration import Parts
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from .rendered_pair import RenderedPair, read_response

#: A function from rectified images, uint8 (H, W) each, to disparity in px, (H, W), NaN without a match, and perhaps its
#: confidence.
Matcher = Callable[..., Array | tuple[Array, Array]]
#: Optional parameters of a matcher function, besides the images.
_OPTIONAL_ARGUMENTS = ("max_disparity_px", "camera")
#: Metrics that the text of an evaluation shows, and their digits.
_SHOWN_METRICS = {"coverage": 3, "epe_px": 3, "bad_1": 3, "l1_m": 4}


@dataclass(frozen=True)
class Evaluation:
    """The result of ``evaluate``.

    ``summary`` has the mean metrics over all pairs by method, ``rows`` a dictionary for each pair and method (its keys
    are in the manual's page on metrics), ``notes`` sentences on the limits of the comparison. The files are in
    ``folder``; ``report`` is the page to open in a browser.
    """

    folder: Path
    summary: dict[str, dict[str, float | None]]
    rows: list[dict[str, Any]]
    notes: list[str]

    @property
    def report(self) -> Path:
        """Path of the HTML page with all results."""
        return self.folder / "report.html"

    def __repr__(self) -> str:
        heads = ["method", *_SHOWN_METRICS]
        lines = [
            [name, *(_format_number(numbers.get(key), digits) for key, digits in _SHOWN_METRICS.items())]
            for name, numbers in self.summary.items()
        ]
        widths = [max(len(line[k]) for line in [heads, *lines]) for k in range(len(heads))]
        return "\n".join(
            "  ".join(
                cell.ljust(width) if k == 0 else cell.rjust(width)
                for k, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in [heads, *lines]
        )


def _format_number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def evaluate(
    pairs: RenderedPair | str | Path | Iterable[RenderedPair | str | Path],
    matchers: Sequence[str | Matcher] | Mapping[str, str | Matcher],
    out: str | Path,
    *presets: str | Path,
    jobs: int = 1,
    confidence: Sequence[str] = ("own",),
    **changes: Mapping[str, Any],
) -> Evaluation:
    """Develop pairs, match them, and measure the result against the truth.

    ``pairs`` are pairs, their folders, or data sets. ``matchers`` are names of ours with their options, such as
    ``"sgbm"`` or ``"bm:window=21"``, and functions of your own, in a list, or by names of yours in a dictionary. A
    function gets the left and the right image, uint8 (H, W), rectified, and returns disparities in px, (H, W), left
    column minus right column, NaN where it finds none; a parameter called ``max_disparity_px`` gets the largest
    disparity that the rig can see, ``camera`` the rig. ``presets`` and ``changes`` describe another sensor, as for
    ``RenderedPair.develop``. Results in ``out`` of the same pairs, matchers and settings are not computed again;
    functions of your own run always. ``jobs`` is the number of processes. ``confidence`` are measures of confidence:
    "own", which some matchers state, "left_right" and "sweep", which run our matchers again. A function of your own may
    return a tuple of disparity and confidence, (H, W) from 0 to 1. Raises IcyMoonError for an unknown matcher, a
    function that returns something else, and if nothing can be measured.
    """
    from ..stereo.environment import packages

    packages.require_modules(*packages.PACKAGES)
    from ..stereo.evaluate import evaluate as evaluate_folders
    from ..stereo.matchers.methods import parse_methods
    from ..support.temporary_folders import open_scratch_folder

    folders = [
        each.folder if isinstance(each, RenderedPair) else Path(each)
        for each in ([pairs] if isinstance(pairs, RenderedPair | str | Path) else pairs)
    ]
    response = read_response(presets, changes)
    ours, named, functions = _sort_matchers(matchers)
    stated = [f"{name}={text}" for name, text in named.items()]
    methods = parse_methods(",".join(ours), named=stated) if ours or named else []
    with open_scratch_folder() as scratch:
        predictions = [
            f"{name}={_predict_all(name, function, folders, response, scratch)}" for name, function in functions.items()
        ]
        report = evaluate_folders(
            folders,
            methods,
            Path(out).absolute(),
            response,
            jobs=jobs,
            predictions=predictions,
            confidence=confidence,
        )
    rows = [dict(row) for row in report["rows"]]
    if failed := [row for row in rows if row["status"] == "failed"]:
        raise IcyMoonError(
            f"{len(failed)} of {format_count(len(rows), 'measurement')} failed, the first one: {failed[0]['error']}"
        )
    return Evaluation(Path(out).absolute(), _average_metrics(rows), rows, list(report["notes"]))


def _sort_matchers(
    matchers: Sequence[str | Matcher] | Mapping[str, str | Matcher],
) -> tuple[list[str], dict[str, str], dict[str, Matcher]]:
    """Sort the matchers into three groups: ours under their own names as a list, ours under names of the user as a
    dictionary, and functions by their names. Raises IcyMoonError for a function without a usable or unique name."""
    from ..settings.topics.trust_boundary import OWN_NAME

    if isinstance(matchers, str):
        matchers = [matchers]
    named = (
        matchers.items()
        if isinstance(matchers, Mapping)
        else [(each if isinstance(each, str) else getattr(each, "__name__", "function"), each) for each in matchers]
    )
    functions = {name.replace("<lambda>", "lambda"): each for name, each in named if callable(each)}
    if bad := [name for name in functions if not OWN_NAME.fullmatch(name)]:
        raise IcyMoonError(
            f"A function is called {bad[0][:60]!r}; give it a name of at most 40 letters, digits, - and "
            "_ in a dictionary, because a column and a folder get this name."
        )
    for name, count in Counter(name for name, _ in named).items():
        if count > 1 and name.replace("<lambda>", "lambda") in functions:
            raise IcyMoonError(f"{count} matchers have the name {name}; give them unique names in a dictionary.")
    texts = {name: each for name, each in named if isinstance(each, str)}
    if isinstance(matchers, Mapping):
        return (
            [text for name, text in texts.items() if name == text],
            {name: text for name, text in texts.items() if name != text},
            functions,
        )
    return list(texts.values()), {}, functions


def _predict_all(name: str, function: Matcher, folders: Sequence[Path], response: Parts, scratch: Path) -> Path:
    """Run a function on all pairs, and return the folder with a disparity map for each.

    Raises IcyMoonError if the function returns no disparity map.
    """
    from ..stereo.images.image_files import write_npy
    from ..stereo.matchers.search_range import MAX_SEARCHED_PX, find_rig_range
    from ..stereo.measure.prepare_pair import list_distinct_pairs, prepare_pair

    asked = [key for key in _OPTIONAL_ARGUMENTS if key in inspect.signature(function).parameters]
    found = scratch / name
    for folder in list_distinct_pairs(folders):
        prepared = prepare_pair(folder, response)
        seen = find_rig_range(prepared.facts["settings"], not prepared.facts["rendered"].get("edited_by_hand"))
        given = {"max_disparity_px": seen.most_px if seen else MAX_SEARCHED_PX, "camera": prepared.depth_camera}
        images = prepared.left.copy(), prepared.right.copy()
        result = function(*images, **{key: given[key] for key in asked})
        result, confidence = result if isinstance(result, tuple) and len(result) == 2 else (result, None)
        disparity = np.asarray(result)
        if disparity.shape != prepared.left.shape or disparity.dtype.kind not in "fiu":
            raise IcyMoonError(
                f"The matcher {name} returns {disparity.dtype} values of shape {disparity.shape}; "
                f"return disparities in px of shape {prepared.left.shape}, NaN where there is none."
            )
        write_npy(found / f"{prepared.pair.name}.npy", disparity.astype(np.float32))
        if confidence is not None:
            write_npy(found / f"{prepared.pair.name}_confidence.npy", np.asarray(confidence))
    return found


def _average_metrics(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float | None]]:
    """Average the metrics of each method over the pairs that passed their self-check; None where no pair has a
    number."""
    from ..stereo.measure.confidence_metrics import list_confidence_numbers
    from ..stereo.measure.row_metrics import NUMBERS

    found: dict[str, dict[str, float | None]] = {}
    for method in dict.fromkeys(row["method"] for row in rows):
        mine = [row for row in rows if row["method"] == method and row["status"] == "ok"]
        found[method] = {}
        for key in NUMBERS:
            values = [row[key] for row in mine if row.get(key) is not None]
            found[method][key] = float(np.mean(values)) if values else None
        stated = [list_confidence_numbers(row) for row in mine]
        for key in dict.fromkeys(key for numbers in stated for key in numbers):
            values = [numbers[key] for numbers in stated if numbers.get(key) is not None]
            found[method][key] = float(np.mean(values)) if values else None
    return found
