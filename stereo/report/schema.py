"""The content of ``report.json``, and of the rows and facts from which it is made. An undefined number is null.

``summary.json`` is the report without ``rows`` and ``pairs``, which grow with the data set, but with ``shown``: the
rows of the pairs whose pictures are in the HTML report.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NotRequired, TypedDict

from ...support.file_schemas import ANYTHING, COUNT, FLAG, NUMBER, PIXELS, TABLE, TEXT, Each, Maybe, Shape
from ..measure import common_pixels
from ..measure.confidence_metrics import CALIBRATION_SUMS, CONFIDENCE_METRICS
from ..measure.row_metrics import NUMBERS
from .notes import BAKED, NOISE, SEARCH
from .row_log import Row


class Comparison(TypedDict):
    """Two methods compared by a metric, see ``summary.compare_methods``; a line of ``comparisons.csv``."""

    a: str
    b: str
    metric: str
    kind: str  # "ratio" or "difference"
    pairs: int  # where both methods are defined
    scenes: int
    typical: float | None  # a / b or a - b in the typical scene
    typical_low: float | None  # its simultaneous 95 % bounds
    typical_high: float | None
    better: str | None  # the better method in the typical scene; null without a verdict
    p: float | None  # adjusted
    detectable: float | None
    scenes_needed: int  # number of scenes for a verdict
    value: float | None  # the mean over scenes
    low: float | None  # its 95 % bounds
    high: float | None


class Failure(TypedDict):
    """A pair that could not be measured, by one ``method`` or by all methods; or a pair that is left out of the
    averages.
    """

    pair: str
    message: str
    method: NotRequired[str]


class Report(TypedDict):
    """The content of ``report.json``, which also has ``shared_settings``: the settings that all pairs have in
    common.
    """

    format: str
    version: int
    summary: list[dict[str, Any]]  # entry of each method, see ``summary.summarise_method``, with its ``ranks``
    curves: dict[str, str]  # pictures of the error by the setting that varies, relative to the report
    comparisons: list[Comparison]
    verdicts: str  # the conclusions of the comparisons
    typical_differences: list[str]  # sentences on the typical difference between every two methods
    rare_failures: list[str]  # sentences on the methods that fail heavily in few pairs
    rows: Sequence[Row]  # read from the disk on demand, see ``ROW``
    pairs: Sequence[Row]  # the facts of each usable pair, see ``FACTS``; read on demand too
    failed: list[Failure]
    suspect: list[Failure]  # pairs whose eyes contradict each other or the truth
    notes: list[str]  # sentences on the limits of the comparison
    briefs: list[str]  # the first parts of the notes, for places with little room
    doubts: list[str]  # the notes that make results doubtful
    noise_doubt: float  # difference of mean shares of wrong or missing pixels that noise of the renders may make
    plug_ins: list[dict[str, Any]]  # the metrics of plug-ins, see ``plug_in.PluginMetric.to_json``
    provenance: Mapping[str, Any]


_NUMBER_OR_NULL = Maybe(NUMBER, null=True)
#: A row: one method on one pair. ``report.json`` has it without ``LONG``.
ROW: dict[str, Shape] = {
    "status": TEXT,  # "ok", "suspect" or "failed"
    "error": TEXT,  # why it failed
    "images": Each(TEXT, TEXT),  # paths of ``depth``, ``error``, ``disparity`` (npz), and if asked for ``points``, maps
    "options": TABLE,  # all of the matcher
    "facts": TABLE,  # on the run of the method, if it states them
    "search": SEARCH,  # the disparities that were searched, and the share of true ones outside
    "counts": Each(COUNT, TEXT),  # numbers of pixels per outcome
    "strata": TABLE,
    "sparsification": TABLE,
    "error_curve": Each(ANYTHING),
    "histograms": Each(Each(NUMBER), TEXT),
    # Numbers on the pixels that another method measured too, by its label; and the key of its row.
    "common": Each({"key": TEXT, **dict.fromkeys(common_pixels.NUMBERS, _NUMBER_OR_NULL)}, TEXT),
    "plug_ins": Maybe(Each(_NUMBER_OR_NULL, TEXT)),
    "plug_in_faults": Maybe(Each(TEXT, TEXT)),
    # By measure of confidence: its metrics, its curves, and its calibration. Absent where there is no confidence.
    "confidence": Maybe(Each(dict.fromkeys(CONFIDENCE_METRICS, _NUMBER_OR_NULL), TEXT)),
    "confidence_curves": Maybe(
        Each(
            {
                "curve": Each(NUMBER),
                "best": Each(NUMBER),
                "calibration": dict.fromkeys(CALIBRATION_SUMS, Each(NUMBER)),
            },
            TEXT,
        )
    ),
    **dict.fromkeys(NUMBERS, _NUMBER_OR_NULL),
}
#: Entries of rows that only ``results.jsonl`` contains: the summary has their sums, or only a later run needs them.
LONG = ("strata", "sparsification", "histograms", "common", "confidence_curves")
#: Shape of the facts of a pair (see ``measure.prepare_pair``): the entries that are read again.
FACTS: dict[str, Shape] = {
    "pair": TEXT,
    "key": TEXT,
    "images": Each(TEXT, TEXT),  # paths of ``left``, ``right`` and ``true_depth``
    "settings": Each(TABLE, TEXT),
    "self_check": {"ok": FLAG, "problems": Each(TEXT)},
    "notes": Maybe(Each(TEXT)),
    "warnings": Maybe(Each(TEXT)),
    "rendered": TABLE,
    "width_px": PIXELS,
    "height_px": PIXELS,
    "true": NUMBER,
    "visible": _NUMBER_OR_NULL,
    "exposure_s": Maybe(NUMBER),
    "scene": Maybe(TEXT),
    "noise": NOISE,
    "occlusion": Maybe(TEXT, null=True),
    "baked": BAKED,
}
