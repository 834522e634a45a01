"""Results of the evaluator in Blender: metrics, error images and their files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy

from ..settings import description
from ..settings.blender import scene_properties
from ..settings.table import list_differing_settings
from ..settings.topics.declaration import Setting
from ..settings.topics.scene import Settings, typed
from ..stereo.matchers.methods import describe_method
from ..stereo.report.table_columns import NO_RESULT, RANKING_METRIC, is_best
from ..support.errors import IcyMoonError
from ..support.file_schemas import COUNT, NUMBER, TABLE, TEXT, Each, Maybe, find_fault, read_record
from ..support.files import explain_disk_errors
from ..support.foreign_bytes import parse_json
from ..support.number_text import format_count
from . import image_editor, last_variations, trusted_reports
from .operator_type import ExplainedOperator
from .render import find_dataset_folder
from .sidebar_text import describe_place, format_for_window, name_settings
from .window_areas import push_undo

#: Columns of a matcher's row in a report that the scene keeps.
METRICS = ("total_bad_1", "coverage", "l1_m", "l1_rate_10", "si_rmse", "dod")
_ROW_SHAPE = {
    "method": TEXT,
    **{name: Maybe(NUMBER, null=True) for name in METRICS},
    "n": Maybe(COUNT),
    "pairs": Maybe(COUNT),
    "ranks": Maybe(Each(Each(COUNT), TEXT)),
}
#: Lists of sentences of a report that the scene keeps, see ``StoredResults``.
_SENTENCE_LISTS = ("notes", "briefs", "rare_failures", "doubts", "typical_differences")
_RESULTS_SHAPE = {
    "made": TEXT,
    "scope": TEXT,
    "pairs": Each(TEXT),
    "settings": Each(TABLE, TEXT),
    "summary": Each(_ROW_SHAPE),
    **dict.fromkeys(_SENTENCE_LISTS, Maybe(Each(TEXT))),
    "noise_doubt": Maybe(NUMBER),
}
_FILES_SHAPE = Maybe(Each({"method": TEXT, "images": Maybe(Each(TEXT, TEXT))}))
_REPORT_SHAPE = {
    "summary": Each(_ROW_SHAPE),
    "shown": _FILES_SHAPE,
    "rows": _FILES_SHAPE,
    "curves": Maybe(Each(TEXT, TEXT)),
    **dict.fromkeys(_SENTENCE_LISTS, Maybe(Each(TEXT))),
    "noise_doubt": Maybe(NUMBER),
    "provenance": Maybe({"created": Maybe(TEXT), "response_overrides": Maybe(TABLE)}),
}
#: Maximum number of characters of a text from a file.
_MAX_TEXT_CHARACTERS = 40
#: Maximum number of characters of a note on the results, and of notes in the panel; the report has all notes.
_MAX_NOTE_CHARACTERS, _MAX_NOTES = 400, 2
#: Settings of the data set that change the results of each scope, although they have the effect "run".
_COUNT_TOO = {
    "DATASET": ("folder", "methods"),
    "SCENE": ("folder", "methods", "headings"),
    last_variations.SCOPE: ("methods",),
}


@dataclass(frozen=True)
class StoredResults:
    """The last evaluation of a scene: its time, scope, pairs and settings, a row of ``METRICS`` for each matcher, and
    notes on the limits of the results.

    It comes from a .blend file, which anyone may have written: show it, but never open a file or run code that it
    names.
    """

    made: str
    scope: str
    pairs: tuple[str, ...]
    settings: Settings
    summary: tuple[dict[str, Any], ...]
    noise_doubt: float = 0.0  # smaller differences of wrong shares may be noise; 0 in results of older versions
    notes: tuple[str, ...] = ()
    briefs: tuple[str, ...] = ()  # the notes in brief
    rare_failures: tuple[str, ...] = ()  # which matchers fail heavily in few pairs
    doubts: tuple[str, ...] = ()  # the notes that make results doubtful
    typical_differences: tuple[str, ...] = ()  # between every two matchers, with intervals


def keep_results(scene: bpy.types.Scene, scope: str, settings: Settings, pairs: Sequence[str] = ()) -> None:
    """Store with a scene the evaluation that was just written into ``find_evaluation_folder(settings, scope)``.

    ``pairs`` are the ids of its pairs, empty for a whole data set. Raises IcyMoonError if the report cannot be read.
    """
    folder = find_evaluation_folder(settings, scope)
    report = _read_report(folder)
    trusted_reports.remember_report(folder / "report.html")
    for name, value in report.get("provenance", {}).get("response_overrides", {}).items():  # the response that was used
        topic, _, key = name.partition(".")
        settings = description.merged(settings, description.check({topic: {key: value}}, "report.json"))
    kept = {
        "made": _read_creation_time(report),
        "scope": scope,
        "pairs": list(pairs),
        "settings": settings,
        "summary": [
            {key: value for key, value in _complete_row(row).items() if key in _ROW_SHAPE} for row in report["summary"]
        ],
        **{key: report.get(key, [])[:_MAX_NOTES] for key in _SENTENCE_LISTS},
        "noise_doubt": report.get("noise_doubt", 0.0),
    }
    scene.icymoon.results = json.dumps(kept)


def read_stored_results(scene: bpy.types.Scene) -> StoredResults | None:
    """Read the last evaluation of a scene; None without an evaluation, or if it cannot be read."""
    return _parse_results(scene.icymoon.results)


@lru_cache(maxsize=8)
def _parse_results(text: str) -> StoredResults | None:
    try:
        found = parse_json(text)
    except ValueError:
        return None
    if find_fault(found, _RESULTS_SHAPE):
        return None
    sentences: dict[str, Any] = {
        key: tuple(_clean_text(note, _MAX_NOTE_CHARACTERS) for note in found.get(key, ())[:_MAX_NOTES])
        for key in _SENTENCE_LISTS
    }
    return StoredResults(
        _clean_text(found["made"]),
        found["scope"],
        tuple(map(_clean_text, found["pairs"])),
        typed(found["settings"]),
        tuple(sorted(map(_complete_row, found["summary"]), key=_sort_key)),
        **sentences,
        noise_doubt=float(found.get("noise_doubt", 0.0)),
    )


def _complete_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """Complete a summary's row with all entries of the panel. Of the ranks, only the rank by ``RANKING_METRIC`` is
    kept.

    A summary of an older version lacks ranks and the number of measured pixels.
    """
    rank = row.get("ranks", {}).get(RANKING_METRIC, ())
    return {
        **dict.fromkeys(METRICS),
        "n": 1,
        **row,
        "method": _clean_text(row["method"]),
        "ranks": {RANKING_METRIC: rank} if len(rank) == 2 else {},
    }


def _sort_key(row: Mapping[str, Any]) -> tuple[float, float]:
    """Return the sorting key of a matcher: its share of wrong or missing pixels, then its error on the other pixels."""
    wrong, error = row.get("total_bad_1") if row.get("n", 1) else None, row.get("l1_m")
    return math.inf if wrong is None else wrong, math.inf if error is None else error


def _clean_text(text: str, longest: int = _MAX_TEXT_CHARACTERS) -> str:
    return "".join(c if c.isprintable() else " " for c in text[:longest])


def find_evaluation_folder(settings: Settings, scope: str) -> Path:
    """Return the folder for the evaluation of a scene ('SCENE') or a whole data set (another scope).

    Raises IcyMoonError if the data set has no valid folder.
    """
    return find_dataset_folder(settings) / _name_folder(scope)


def _name_folder(scope: str) -> str:
    return "evaluation_scene" if scope == "SCENE" else "evaluation"


def select_dataset(scene: bpy.types.Scene, settings: Settings, scope: str) -> Settings:
    """Return the settings with the data set folder of a scope: the scene's own folder, or the folder of its variations.

    Raises IcyMoonError if there are no variations.
    """
    return last_variations.use_folder(scene, settings) if scope == last_variations.SCOPE else settings


def read_summary(scene: bpy.types.Scene) -> list[dict[str, Any]]:
    """Read a row of metrics for each matcher of a scene's last evaluation; empty without an evaluation."""
    found = read_stored_results(scene)
    return list(found.summary) if found else []


def list_limits(scene: bpy.types.Scene) -> tuple[str, ...]:
    """List sentences on the limits of the results of a scene's last evaluation, the most important first."""
    found = read_stored_results(scene)
    return found.notes if found else ()


def list_brief_limits(scene: bpy.types.Scene) -> tuple[str, ...]:
    """List the limits of the results in brief; empty if an older version wrote the results."""
    found = read_stored_results(scene)
    return found.briefs if found else ()


def casts_doubt_on_results(scene: bpy.types.Scene, brief: str) -> bool:
    """Return whether the note that begins with ``brief`` casts doubt on the results of a scene's last evaluation."""
    found = read_stored_results(scene)
    return found is not None and any(doubt.startswith(brief) for doubt in found.doubts)


def list_rare_failures(scene: bpy.types.Scene) -> tuple[str, ...]:
    """List sentences on matchers that fail heavily in few pairs, on which the ranks depend."""
    found = read_stored_results(scene)
    return found.rare_failures if found else ()


def list_typical_differences(scene: bpy.types.Scene) -> tuple[str, ...]:
    """List sentences on how matchers differ in the typical scene, with intervals; empty if an older version wrote the
    results."""
    found = read_stored_results(scene)
    return found.typical_differences if found else ()


def list_changed_settings(scene: bpy.types.Scene) -> list[str]:
    """List the labels of the settings that have changed since the last evaluation."""
    return [describe_place(topic, s) for topic, s in _find_changed_settings(scene)]


def _find_changed_settings(scene: bpy.types.Scene) -> list[tuple[str, Setting]]:
    found = read_stored_results(scene)
    if found is None:
        return []
    present = scene_properties.read_for_display(scene.icymoon)
    return [
        (topic, s)
        for topic, s in list_differing_settings(found.settings, present)
        if _affects_results(topic, s, found.scope)
    ]


def _affects_results(topic: str, setting: Setting, scope: str) -> bool:
    """Return whether results of a scope depend on a setting.

    Results of a data set do not depend on the scene's settings for rendering, since its plan contains these settings.
    """
    if setting.effect == "run":
        return topic == "dataset" and setting.key in _COUNT_TOO.get(scope, ())
    return scope == "SCENE" or setting.effect == "response"


def list_notes(scene: bpy.types.Scene) -> list[str]:
    """List sentences on a scene's last evaluation: its pairs and time, then any settings that have changed since."""
    found = read_stored_results(scene)
    if found is None:
        return []
    subject = _describe_pairs(found.pairs, scene.icymoon.pairs.split())
    if found.scope != "SCENE":
        count = max((row.get("pairs", 0) for row in found.summary), default=0)  # older versions stored no count
        whole = "variations" if found.scope == last_variations.SCOPE else "data set"
        subject = f"Of the {whole}" + (f", {format_count(count, 'pair')}" if count else "")
    sentences = [f"{subject}; measured {found.made.replace('T', ' ')[:16]} UTC"]
    changed = _find_changed_settings(scene)
    other = [(topic, s) for topic, s in changed if s.key != "folder"]
    if other:
        rendered = any(s.effect != "response" and s.key != "methods" for _, s in other)
        sentences.append(
            f"Measured with other settings than the present ones: {name_settings(other)}. "
            f"{'Render and evaluate' if rendered else 'Evaluate'} again."
        )
    elif changed:
        sentences.append(
            "The files of these results are in another folder than Data Set ▸ Folder. "
            "Set that folder again to see them, or render and evaluate in this one."
        )
    elif found.scope == last_variations.SCOPE and found.settings.dataset.folder != scene.icymoon.variations.folder:
        sentences.append("Other variations were rendered since; press Evaluate These Variations to measure those.")
    elif missing := explain_missing_results(scene):
        sentences.append(missing)
    return sentences


def _describe_pairs(pairs: Sequence[str], rendered_last: Sequence[str]) -> str:
    """Describe the pairs of an evaluation in words, since the user does not know ids."""
    last, several = bool(pairs) and set(pairs) <= set(rendered_last), len(pairs) > 1
    if last:
        return f"Of the {format_count(len(pairs), 'pair')} rendered last" if several else "Of the pair rendered last"
    return f"Of {format_count(len(pairs), 'earlier pair')}" if several else "Of an earlier pair"


def _read_report(folder: Path) -> dict[str, Any]:
    """Read a finished evaluation from its ``summary.json``, else from its ``report.json``."""
    brief = folder / "summary.json"
    path = brief if brief.is_file() else folder / "report.json"
    try:
        return _read_once(path, path.stat().st_mtime_ns)
    except OSError:
        raise IcyMoonError(f"There is no report in {folder}; press Evaluate again.") from None


@lru_cache(maxsize=8)
def _read_once(path: Path, written_ns: int) -> dict[str, Any]:
    return dict(read_record(path, _REPORT_SHAPE, "press Evaluate again"))


def _read_creation_time(report: Mapping[str, Any]) -> str:
    return str(report.get("provenance", {}).get("created", ""))


def find_measured_dataset(scene: bpy.types.Scene) -> Path:
    """Return the data set folder of a scene's last evaluation. Raises IcyMoonError if there is no evaluation."""
    own = typed({"dataset": {"folder": scene.icymoon.dataset.folder}})
    return find_dataset_folder(select_dataset(scene, own, _read_results(scene).scope))


def _read_results(scene: bpy.types.Scene) -> StoredResults:
    found = read_stored_results(scene)
    if found is None:
        raise IcyMoonError("This scene has not been evaluated yet; press Evaluate.")
    return found


def find_report_folder(scene: bpy.types.Scene) -> Path:
    """Find the folder of a scene's last evaluation. Raises IcyMoonError if it is missing or contains another
    evaluation."""
    found = _read_results(scene)
    folder = find_measured_dataset(scene) / _name_folder(found.scope)
    if _clean_text(_read_creation_time(_read_report(folder))) != found.made:
        raise IcyMoonError(f"Another evaluation has replaced these results in {folder}; press Evaluate again.")
    return folder


def describe_result(row: Mapping[str, Any]) -> str:
    """Describe the result of a matcher in a sentence, from its row of a summary."""
    method = describe_method(row["method"])
    if not row["n"]:
        return f"{method}: {NO_RESULT}"
    return (
        f"{method}: {format_percent(row['total_bad_1'])} wrong or missing; covers "
        f"{format_percent(row['coverage'])} with a mean "
        f"error of {format_metres(row['l1_m'])}"
    )


def read_noise_doubt(scene: bpy.types.Scene) -> float:
    """Read the difference between matchers' shares of wrong pixels that noise of the renders may cause, by the last
    evaluation."""
    found = read_stored_results(scene)
    return found.noise_doubt if found else 0.0


def describe_verdict(rows: Sequence[Mapping[str, Any]], noise_doubt: float = 0.0) -> str:
    """Name the matcher with the fewest wrong pixels, and their share, in one line. ``rows`` come from ``read_summary``.

    The matcher is called the best only if the report's comparison ranks it so. The first two matchers are too close to
    call if this comparison leaves all ranks open, or if noise may make their difference, see ``read_noise_doubt``.
    """
    measured = [row for row in rows if row["n"]]
    if not measured:
        return "No matcher has a result"
    first = measured[0]
    name, wrong = describe_method(first["method"]), format_percent(first["total_bad_1"])
    if len(measured) == 1:
        return f"{name}: {wrong} wrong"
    second = measured[1]
    is_ranked = RANKING_METRIC in first["ranks"] and RANKING_METRIC in second["ranks"]
    best = is_best(first, RANKING_METRIC, rows)
    if _compute_lead(first, second) <= noise_doubt or (is_ranked and not best):
        other = f"{describe_method(second['method'])} {format_percent(second['total_bad_1'])}"
        return f"Too close to call: {name} {wrong}, {other} wrong"
    return f"Best: {name}, {wrong} wrong" if best else f"Fewest wrong: {name}, {wrong}"


def describe_nearer(rows: Sequence[Mapping[str, Any]]) -> str:
    """Name the matcher with the smallest mean error if it is not the one with the fewest wrong pixels, with the shares
    of pixels that both measure; empty otherwise. A matcher that measures easy pixels alone errs little on them.
    ``rows`` come from ``read_summary``."""
    measured = [row for row in rows if row["n"] and None not in (row["l1_m"], row["coverage"])]
    if not measured:
        return ""
    first, nearest = measured[0], min(measured, key=lambda row: float(row["l1_m"]))
    if nearest is first:
        return ""
    name, other = describe_method(nearest["method"]), describe_method(first["method"])
    shares = f"{format_percent(nearest['coverage'])} of the pixels, {other} {format_percent(first['coverage'])}"
    return f"{name} has the smallest mean error; it measures {shares}"


def _compute_lead(first: Mapping[str, Any], second: Mapping[str, Any]) -> float:
    """Return the next matcher's share of wrong pixels less the first matcher's; infinite if a share is missing."""
    shares = first["total_bad_1"], second["total_bad_1"]
    return math.inf if None in shares else float(shares[1] - shares[0])


def describe_results(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Describe each row by ``describe_result``, the best matcher last, because the status bar shows the last report."""
    return [describe_result(row) for row in sorted(rows, key=_sort_key, reverse=True)]


def format_number(value: float | None, digits: int) -> str:
    """Format a metric; a dash for a missing value."""
    return "–" if value is None else f"{value:.{digits}f}"


def format_percent(value: float | None) -> str:
    """Format a share in per cent; a dash for a missing value."""
    return "–" if value is None else f"{100 * value:.1f} %"


def format_metres(value: float | None) -> str:
    """Format a length in metres to a millimetre; a dash without a unit for a missing value."""
    return "–" if value is None else f"{value:.3f} m"


def _find_files(scene: bpy.types.Scene, kind: str) -> list[tuple[str, Path]]:
    """Find (matcher, file) of each existing file of a kind, from the best matcher to the worst."""
    try:
        folder = find_report_folder(scene)
        report = _read_report(folder)
    except IcyMoonError:
        return []
    badness = {row["method"]: _sort_key(row) for row in report["summary"]}
    found = [
        (row["method"], folder / row["images"][kind])
        for row in report.get("shown", report.get("rows", []))
        if kind in row.get("images", {}) and row["method"] in badness
    ]
    found.sort(key=lambda each: badness[each[0]])
    return [
        (method, path) for method, path in found if path.resolve().is_relative_to(folder.resolve()) and path.is_file()
    ]


def find_curves(scene: bpy.types.Scene) -> dict[str, Path]:
    """Find the charts of the last evaluation, error against setting, by the varied setting (``topic.key``)."""
    try:
        folder = find_report_folder(scene)
        listed = _read_report(folder).get("curves", {})
    except IcyMoonError:
        return {}
    return {
        name: path
        for name, file in listed.items()
        if (path := folder / file).resolve().is_relative_to(folder.resolve()) and path.is_file()
    }


def find_disparity_files(scene: bpy.types.Scene, method: str) -> dict[str, Path]:
    """Find the stored disparities of a matcher, by the id of the pair."""
    return {path.parent.name: path for name, path in _find_files(scene, "disparity") if name == method}


def list_methods_with_disparities(scene: bpy.types.Scene) -> list[str]:
    """List the matchers whose errors can be painted, from the best to the worst."""
    return list(dict.fromkeys(method for method, _ in _find_files(scene, "disparity")))


def find_error_images(scene: bpy.types.Scene, method: str = "") -> list[Path]:
    """Find the existing error images of the last evaluation: images of ``method`` first, then the others from the best
    matcher to the worst."""
    found = sorted(_find_files(scene, "error"), key=lambda each: each[0] != method)
    return [path for _, path in found]


def list_methods_with_error_images(scene: bpy.types.Scene) -> set[str]:
    """Return the matchers that have an error image."""
    return {method for method, _ in _find_files(scene, "error")}


def find_depth_images(scene: bpy.types.Scene) -> list[Path]:
    """Find the existing depth images of the last evaluation, from the best matcher to the worst."""
    return [path for _, path in _find_files(scene, "depth")]


def find_point_files(scene: bpy.types.Scene, method: str) -> list[Path]:
    """Find the measured surfaces of a matcher, one for each evaluated pair."""
    return [path for name, path in _find_files(scene, "points") if name == method]


def list_methods_with_points(scene: bpy.types.Scene) -> list[str]:
    """List the matchers whose measured surface can be shown, from the best to the worst."""
    return list(dict.fromkeys(method for method, _ in _find_files(scene, "points")))


def show_error_image(context: bpy.types.Context, open_window: bool, method: str = "") -> bool:
    """Show, by ``show_images``, the error images, with ``method`` first, and then any depth and confidence images."""
    errors, confidences = find_error_images(context.scene, method), _find_files(context.scene, "confidence")
    names = {path: f"Error of {describe_method(name)}" for name, path in _find_files(context.scene, "error")}
    names |= {path: f"Depth of {describe_method(name)}" for name, path in _find_files(context.scene, "depth")}
    names |= {path: f"Confidence of {describe_method(name)}" for name, path in confidences}
    more = [*find_depth_images(context.scene), *(path for _, path in confidences)]
    return show_images([*errors, *more] if errors else [], open_window, names)


def show_images(
    paths: list[Path],
    open_window: bool,
    names: Mapping[Path, str] | None = None,
    note: Callable[[bpy.types.Image], None] | None = None,
) -> bool:
    """Load images and show the first in an Image Editor, as an undo step. Returns False if no editor shows or will show
    it.

    For ``open_window`` see ``image_editor.show_in_editor``. ``names`` gives images other names in the editor than their
    files have. ``note`` is called with each loaded image.
    """

    def show(area: bpy.types.Area) -> None:
        images = [bpy.data.images.load(str(path), check_existing=True) for path in paths]
        for image, path in zip(images, paths, strict=True):
            image.reload()
            image.name = (names or {}).get(path, image.name)
            if note is not None:
                note(image)
        area.spaces.active.image = images[0]
        image_editor.zoom_to_fit(area)
        push_undo("Show Images")

    return bool(paths) and not bpy.app.background and image_editor.show_in_editor(open_window, show)


def explain_missing_results(scene: bpy.types.Scene) -> str:
    """Explain why the files of a scene's last evaluation cannot be shown; empty if they can be shown."""
    if read_stored_results(scene) is None:
        return "This scene has not been evaluated yet"
    try:
        find_report_folder(scene)
    except IcyMoonError as error:
        return str(error)
    return ""


class ResultOperator(ExplainedOperator):
    """Mix-in: an operator that needs an evaluation of the scene."""

    @classmethod
    def find_obstacle(cls, context: bpy.types.Context) -> str:
        return explain_missing_results(context.scene)


class ICYMOON_OT_show_error(ResultOperator, bpy.types.Operator):
    """Show the errors of a matcher in an Image Editor"""

    bl_idname = "icymoon.show_error"
    bl_label = "Show Stereo Error Image"

    method: bpy.props.StringProperty(name="Matcher", description="Matcher of the errors; empty for the most accurate")

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not find_error_images(context.scene):
            self.report({"ERROR"}, "The error images do not exist any more; press Evaluate again.")
            return {"CANCELLED"}
        show_error_image(context, open_window=True, method=self.method)
        return {"FINISHED"}


class ICYMOON_OT_open_report(ResultOperator, bpy.types.Operator):
    """Open the report of the last evaluation in the web browser"""

    bl_idname = "icymoon.open_report"
    bl_label = "Open Evaluation Report"

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            page = find_report_folder(context.scene) / "report.html"
            if not page.is_file():
                raise IcyMoonError("The report no longer exists; press Evaluate again.")
            with explain_disk_errors("read", page):
                if not trusted_reports.is_own_report(page):
                    raise IcyMoonError(
                        f"{page} was not made by you on this machine, and a web page can run unknown "
                        "scripts; press Evaluate to make it again."
                    )
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        bpy.ops.wm.url_open(url=page.as_uri())
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_show_error, ICYMOON_OT_open_report)
