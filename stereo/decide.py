"""Decisions on a lander's workspace from the depths of matchers, compared with decisions from the true depth.

As in ``evaluate``, a row is one method on one pair. It is written to the disk at once, and never computed again.
"""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..physics.excavation import arm_reach
from ..physics.light.sky import elevation_deg
from ..physics.random_numbers.seeds import make_generator
from ..render.pairs.pair_folder import Pair
from ..support.arrays import Array
from ..support.errors import DiskError, IcyMoonError, describe_error
from ..support.file_schemas import FILE_NAME, NUMBER, TABLE, TEXT, Each, Maybe, Shape, read_record
from ..support.files import make_json_digest, write_bytes, write_json
from ..support.version import version
from .decisions import pictures
from .decisions.calibrated_run import CalibratedRun, CalibrationOrder, prepare_calibrated_run
from .decisions.calibration_file import Conditions
from .decisions.excavation_progress import find_progress, name_series, name_site
from .decisions.joint_faults import find_joint_faults
from .decisions.joint_margin import has_arm
from .decisions.report import FIRST_BYTES, write_decisions
from .decisions.rules import Rules
from .decisions.scoop_of_pair import Scoop, find_scoop, locate_scoop, read_stated_joints
from .decisions.stored_maps import TRUE_DEPTH
from .decisions.workspace import (
    DEFAULT_CELL_M,
    DecisionMaps,
    Workspace,
    compare_beside_lander,
    compare_with_truth,
    count_map_errors,
    decide_from_depth,
    disturb_pose,
    measure_features,
    open_workspace,
    read_sun_direction,
    state_map_errors,
)
from .evaluated_pairs import RenderedPair, Source, check_response, find_sources, sort_by_ground
from .evaluation_files import check_output_folder, has_named_files, remove_leftovers
from .fused_sites import FusedSite, find_fused_sites, list_pairs
from .fusion.fuse import list_lidar_inputs
from .fusion.match_prepared import list_method_inputs, match_prepared
from .fusion.suns import join_disparities
from .images.image_files import write_png
from .matchers.methods import Method, describe_method
from .matchers.resident_process import stop_residents
from .measure.prepare_pair import PreparedPair
from .measure.row_metrics import disparity_to_depth
from .report.row_log import Row, RowLog

Event = Callable[[dict[str, Any]], None]

#: Increased when the same input gives other numbers or files.
DECISIONS_VERSION = 8
_LOG_FILE = "decisions.jsonl"
_ROW_SHAPE: dict[str, Shape] = {
    "status": TEXT,
    "error": TEXT,
    "numbers": Maybe(TABLE, null=True),
    "images": Each(TEXT, TEXT),
}
_FACTS_SHAPE = {
    "pair": FILE_NAME,
    "scene": TEXT,
    "site": TEXT,
    "key": TEXT,
    "images": Each(TEXT, TEXT),
    "sun_elevation_deg": NUMBER,
}


@dataclass(frozen=True)
class PoseError:
    """Standard deviations, per axis, of the lander's error in the position and direction of its camera."""

    mm: float = 0.0
    deg: float = 0.0


EXACT_POSE = PoseError()


@dataclass(frozen=True)
class _DecideRun:
    methods: Sequence[Method]
    out: Path
    response: Mapping[str, Mapping[str, Any]]
    rules: Rules
    cell_m: float | None
    pose: PoseError
    seed: int
    min_confidence: float
    scales: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)  # of map errors, by label

    def find_method(self, label: str) -> Method | None:
        """Return the method with this label; None for the true depth."""
        return next((method for method in self.methods if method.label == label), None)

    def make_generator(self, *names: str) -> np.random.Generator:
        """Make the random generator of a pair, or of a method on the pair, from their ``names``."""
        return make_generator(self.seed, "pose", *(int(make_json_digest(name), 16) % 2**32 for name in names))

    def prepare_calibrated_run(
        self, sources: Sequence[Source], order: CalibrationOrder | None, file: Path | None
    ) -> CalibratedRun:
        """Prepare the calibration that this run makes by ``order`` or takes from ``file``."""
        own = {m.label: make_json_digest([list_method_inputs(m), *list_lidar_inputs(m, "")]) for m in self.methods}
        suns = 1 if order is None and file is None else count_suns(sources)
        conditions = Conditions(DECISIONS_VERSION, self.rules, self.pose.mm, self.pose.deg, self.min_confidence, suns)
        folders = {
            source.name: [pair.folder for pair in list_pairs(source)]
            for source in sources
            if isinstance(source, RenderedPair | FusedSite)
        }
        bare = CalibratedRun({}, conditions, {TRUE_DEPTH: "", **own}, order)
        return prepare_calibrated_run(folders, self.response, self.cell_m or DEFAULT_CELL_M, bare, file)

    def make_digest(self, source: Source) -> str:
        """Make a digest of everything that determines the rows of a pair, except their methods."""
        limit = [self.min_confidence] if self.min_confidence else []
        stated = (self.response, self.rules.to_json(), self.cell_m, self.pose.mm, self.pose.deg, self.seed, *limit)
        return make_json_digest([*source.list_dependencies(), *stated, DECISIONS_VERSION, version()])


def decide_pairs(
    paths: Sequence[Path],
    methods: Sequence[Method],
    out: Path,
    rules: Rules,
    response: Mapping[str, Mapping[str, Any]] | None = None,
    on_event: Event = lambda event: None,
    cell_m: float | None = None,
    pose: PoseError = EXACT_POSE,
    seed: int = 0,
    min_confidence: float = 0.0,
    calibrate: CalibrationOrder | None = None,
    calibration: Path | None = None,
    fuse_suns: bool = False,
) -> dict[str, Any]:
    """Measure decisions on all pairs at ``paths`` by all methods and by the true depth; return ``decisions.json``.

    Writes to ``out``: ``decisions.jsonl`` (each row at once), then ``decisions.csv``, ``decisions.json`` and
    ``decisions.html``. For each pair, ``pairs/<pair>/`` gets the elevation models as GeoTIFF and npy, maps of
    suitability, slope and reach as npy, and pictures. With a ``calibration`` it also gets the standard deviations of
    heights, slopes and roughnesses, as ``<method>_height_sigma.npy`` and so on.

    For ``cell_m`` see ``workspace.open_workspace``, and for ``on_event`` see ``evaluate``. Measurements with a
    confidence below ``min_confidence``, from 0 to 1, are not used; a method that states no confidence fails if this
    limit is above 0.

    ``calibrate`` writes a calibration from these grounds. ``calibration`` is a file that ``calibrate`` wrote on other
    grounds: it guarantees the chosen sites, or the lander abstains.

    ``fuse_suns`` joins the pairs of a site that one camera took in one pose under several Suns, see ``fused_sites``:
    the disparities of each method are joined before they become heights. Light, contrast and the true depth come from
    the last Sun's pair, which names the site.

    Raises IcyMoonError if there is no pair, if pairs cannot be joined, or if ``out`` contains files of another program.
    Before anything is written, it is also raised if ``calibrate`` has too few grounds, or if ``calibration`` does not
    hold for these pairs, rules and methods.
    """
    sources = find_fused_sites(find_sources(paths)) if fuse_suns else find_sources(paths)
    check_response(sources, response or {})
    names = [source.name for source in sources]
    check_output_folder(out, names, FIRST_BYTES)
    run = _DecideRun(methods, out, dict(response or {}), rules, cell_m, pose, seed, min_confidence)
    calibrated = run.prepare_calibrated_run(sources, calibrate, calibration)
    if calibrated.used is not None:
        run = replace(run, scales={label: entry["scales"] for label, entry in calibrated.used.entries.items()})
    remove_leftovers(out)
    log = RowLog(out / _LOG_FILE, _ROW_SHAPE)
    labels = [TRUE_DEPTH, *(method.label for method in methods)]
    failed = _make_rows(sources, run, log, len(labels), on_event)
    log.compact((name, label) for name in names for label in labels)
    place = {name: k for k, name in enumerate(names)}
    failed.sort(key=lambda entry: place[entry["pair"]])
    facts = [found for name in names if (found := _read_facts(out, name)) is not None]
    rows = [log.read(name, label) for name in names for label in labels]
    provenance = {
        "source": ", ".join(str(path.resolve()) for path in paths),
        "seed": seed,
        "pose_error": {"mm": pose.mm, "deg": pose.deg},
        **({"min_confidence": min_confidence} if min_confidence else {}),
        **({"fuse_suns": True} if fuse_suns else {}),
    }
    rows, verdicts = calibrated.judge(rows)
    report = write_decisions(
        out,
        rows,
        facts,
        labels,
        rules,
        find_progress(rows, facts, labels, out, rules.site.disc_m),
        find_joint_faults(rows, facts, labels),
        failed,
        provenance,
        verdicts,
    )
    calibrated.write(verdicts)
    return report


def _make_rows(
    sources: Sequence[Source], run: _DecideRun, log: RowLog, methods: int, on_event: Callable[[dict[str, Any]], None]
) -> list[dict[str, Any]]:
    """Make all missing rows, and return the failed ones with their reasons."""
    failed: list[dict[str, Any]] = []
    done, total = 0, len(sources) * methods
    try:
        for row in (row for source in sort_by_ground(sources) for row in _decide_pair(source, run, log)):
            done += 1
            if row["error"]:
                failed.append({"pair": row["pair"], "method": row["method"], "message": row["error"]})
                on_event({"type": "error", "message": row["error"]})
            on_event(
                {
                    "type": "progress",
                    "fraction": done / total,
                    "done": done,
                    "total": total,
                    "message": f"{row['pair']} {row['method']}",
                }
            )
    finally:
        stop_residents()
    return failed


def _decide_pair(source: Source, run: _DecideRun, log: RowLog) -> Iterator[Row]:
    """Yield the rows of a pair. Missing rows are made and written to the log."""
    content = run.make_digest(source)
    keys = {TRUE_DEPTH: content} | {m.label: _make_row_key(m, list_pairs(source), content) for m in run.methods}
    keys |= {label: make_json_digest([keys[label], scales]) for label, scales in run.scales.items() if label in keys}
    there = {
        label: row
        for label, key in keys.items()
        if (row := log.find(source.name, label, key))
        and row["status"] != "failed"
        and has_named_files(row, run.out, source.name)
    }
    facts = _read_facts(run.out, source.name)
    if len(there) == len(keys) and facts and facts["key"] == content and has_named_files(facts, run.out, source.name):
        yield from there.values()
        return
    try:
        workspace = open_workspace(source.prepare(run.response), run.rules, run.cell_m)
        others = _match_other_suns(source, run, keys.keys() - there.keys())
        _write_facts(workspace, others, run.out, content)
    except DiskError:
        raise
    except Exception as error:
        for label, key in keys.items():
            yield _log_row(log, _make_failed_row(source, label, key, describe_error(error, source.folder)))
        return
    random = run.make_generator(source.name)
    pose = disturb_pose(workspace.pose, run.pose.mm, run.pose.deg, random)
    scoop = find_scoop(workspace.pair, workspace.pose, random)
    for label, key in keys.items():
        if label in there:
            yield there[label]
            continue
        try:
            row = _make_row(source, label, key, "ok" if workspace.prepared.check.ok and others.agree else "suspect")
            row |= _decide_with_method(workspace, others, run.find_method(label), pose, run, scoop)
        except DiskError:
            raise
        except Exception as error:
            where = f"{source.folder} by {describe_method(label)}"
            row = _make_failed_row(source, label, key, describe_error(error, where))
        yield _log_row(log, row)


def count_suns(sources: Sequence[Source]) -> int:
    """Count the Suns of each site. Raises IcyMoonError if the sites have different numbers, because a calibration holds
    for one number only. A pair that cannot be read counts as a site with one Sun.
    """
    numbers = {len(list_pairs(source)): source.name for source in sources}
    if len(numbers) > 1:
        (few, one), *_, (many, other) = sorted(numbers.items())
        raise IcyMoonError(
            f"A calibration takes one number of Suns, and site {one} has {few}, site {other} has {many}; give as many "
            "readable pairs of each site."
        )
    return next(iter(numbers))


@dataclass(frozen=True)
class _OtherSuns:
    """The pairs of a site except the last one: the facts of each pair, and by the label of a method the disparities (H,
    W), px, with their processor seconds, or the error of the method.
    """

    facts: Sequence[Mapping[str, Any]] = ()
    matched: Mapping[str, Sequence[tuple[Array, float]] | IcyMoonError] = field(default_factory=dict)

    @property
    def agree(self) -> bool:
        """Whether the eyes of all pairs agree with each other and with the truth."""
        return not any(fact["suspect"] for fact in self.facts)


def _match_other_suns(source: Source, run: _DecideRun, labels: Collection[str]) -> _OtherSuns:
    """Match every pair of a site except the last one by each of the labelled methods."""
    facts: list[dict[str, Any]] = []
    matched: dict[str, list[tuple[Array, float]] | IcyMoonError] = {}
    for prepared in source.prepare_others(run.response) if isinstance(source, FusedSite) else ():
        facts.append(_describe_sun(prepared))
        for method in (each for each in run.methods if each.label in labels):
            found = matched.setdefault(method.label, [])
            if isinstance(found, IcyMoonError):
                continue
            try:
                found.append(_match_pair(prepared, method, run.min_confidence))
            except DiskError:
                raise
            except Exception as error:
                where = f"{prepared.pair.folder} by {describe_method(method.label)}"
                matched[method.label] = IcyMoonError(describe_error(error, where))
    return _OtherSuns(facts, matched)


def _describe_sun(prepared: PreparedPair) -> dict[str, Any]:
    pair = prepared.pair
    assert isinstance(pair, Pair)
    elevation = elevation_deg(read_sun_direction(pair))
    return {
        "pair": pair.name,
        "sun_elevation_deg": elevation,
        "suspect": not prepared.check.ok,
        "noise": prepared.facts.get("noise"),
    }


def _make_row_key(method: Method, pairs: Sequence[Source], content: str) -> str:
    """Make the digest of everything that determines a row."""
    lidar = [each for pair in pairs for each in list_lidar_inputs(method, pair.name)]
    return make_json_digest([content, list_method_inputs(method), *lidar])


def _log_row(log: RowLog, row: Row) -> Row:
    log.append(row)
    return row


def _make_row(source: Source, label: str, key: str, status: str, error: str = "") -> Row:
    suns = {"suns": len(list_pairs(source))} if isinstance(source, FusedSite) else {}
    return {"pair": source.name, "method": label, "key": key, "status": status, "error": error, **suns}


def _make_failed_row(source: Source, label: str, key: str, message: str) -> Row:
    return _make_row(source, label, key, "failed", message) | {"numbers": None, "images": {}}


def _read_excavation_facts(workspace: Workspace) -> dict[str, Any] | None:
    """Read the entries on the excavation from ``pair.json``, for progress and advice; None without an excavation."""
    stated = workspace.pair.data.get("excavation")
    wanted = ("state", "states", "change_in_region_by_state_m3", "region_m")
    return (
        {
            **{key: stated[key] for key in wanted},
            "advice": [*arm_reach.advise_on_reach(workspace.pair.settings), *stated.get("advice", [])],
        }
        if stated
        else None
    )


def _decide_with_method(
    workspace: Workspace,
    others: _OtherSuns,
    method: Method | None,
    pose: Array,
    run: _DecideRun,
    scoop: Scoop | None,
) -> dict[str, Any]:
    """Decide with a method, or with the true depth if ``method`` is None; return the numbers and files."""
    depth, matching = workspace.prepared.truth, 0.0
    if method is not None:
        depth, matching = _find_depth(workspace.prepared, others, method, run.min_confidence)
    start = time.process_time()
    error_px = 0.0 if method is None else workspace.rules.cells.disparity_error_px
    found = decide_from_depth(workspace, depth, pose, error_px)
    numbers = compare_with_truth(workspace, found) | {
        "features": measure_features(workspace, found),
        "errors": count_map_errors(workspace, found),
    }
    if has_arm(workspace.pair.settings):
        numbers["dem"] |= compare_beside_lander(workspace, found, depth, pose)
    if scoop is not None:
        # A separate generator, so that other methods of this run or an earlier run do not change the numbers.
        random = run.make_generator(workspace.pair.name, TRUE_DEPTH if method is None else method.label)
        numbers["scoop"] = locate_scoop(scoop, depth, workspace.pair, pose, random)
    numbers["cpu_s"] = {"match": matching, "decide": time.process_time() - start}
    return {
        "numbers": numbers,
        "images": _write_maps(workspace, found, numbers, run.out, method)
        | _write_map_errors(workspace, found, run, method),
    }


def _find_depth(
    prepared: PreparedPair, others: _OtherSuns, method: Method, min_confidence: float
) -> tuple[Array, float]:
    """Find the depth (H, W), m, from a method under all Suns, and the processor seconds that it took."""
    matched = others.matched.get(method.label, [])
    if isinstance(matched, IcyMoonError):
        raise matched
    disparities, seconds = zip(*matched, _match_pair(prepared, method, min_confidence), strict=True)
    return disparity_to_depth(prepared, join_disparities(np.stack(disparities))), sum(seconds)


def _match_pair(prepared: PreparedPair, method: Method, min_confidence: float) -> tuple[Array, float]:
    """Match a pair by a method; return the disparity, px, and the processor seconds. If ``min_confidence`` is above 0,
    the disparity is NaN where the confidence is lower.
    """
    disparity, info = match_prepared(method, prepared)
    if min_confidence > 0:
        if info["confidence"] is None:
            raise IcyMoonError(
                f"{describe_method(method.label)} states no confidence, but at least {min_confidence:g} is required; "
                "leave out the limit or the method."
            )
        disparity = np.where(info["confidence"] >= min_confidence, disparity, np.nan)
    return disparity, float(info["seconds"])


def _name_files(method: Method | None) -> str:
    return method.file_name if method else "true_depth"


def _write_map_errors(
    workspace: Workspace, found: DecisionMaps, run: _DecideRun, method: Method | None
) -> dict[str, str]:
    """Write the standard deviations of a method's maps if it has a calibrated scale; return their paths relative to
    ``run.out``.
    """
    scales = run.scales.get(method.label if method else TRUE_DEPTH, {})
    files = {}
    for quantity, values in state_map_errors(workspace, found).scaled(scales).items():
        kind = f"{quantity}_sigma"
        files[kind] = f"pairs/{workspace.pair.name}/{_name_files(method)}_{kind}.npy"
        write_bytes(run.out / files[kind], _encode_npy(values))
    return files


def _write_maps(
    workspace: Workspace, found: DecisionMaps, numbers: Mapping[str, Any], out: Path, method: Method | None
) -> dict[str, str]:
    """Write the elevation model, the suitability and the pictures of a method; return their paths relative to
    ``out``.
    """
    folder, name = out / "pairs" / workspace.pair.name, _name_files(method)
    site, grid = workspace.rules.site, workspace.grid
    chosen = numbers["sites"]["chosen"]
    drawn = {
        "outcome": pictures.draw_outcomes(workspace, found),
        "error": pictures.draw_height_errors(workspace, found),
    }
    for kind, picture in drawn.items():
        write_png(
            folder / f"{name}_{kind}.png",
            pictures.add_ring(picture, chosen, found.dem.height_m.shape, site.disc_m, grid.cell_m),
        )
    write_bytes(folder / f"{name}_dem.tif", found.dem.encode_geotiff(workspace.pair.data.get("ground")))
    for kind, values in (
        ("dem", found.dem.height_m),
        ("suitability", found.sites.margin),
        ("slope", found.sites.layers.slope_deg),
        ("pads", found.pads),
    ):
        write_bytes(folder / f"{name}_{kind}.npy", _encode_npy(values))
    files = (
        {kind: f"{name}_{kind}.png" for kind in drawn}
        | {"tif": f"{name}_dem.tif"}
        | {kind: f"{name}_{kind}.npy" for kind in ("dem", "suitability", "slope", "pads")}
    )
    return {kind: (folder / file).relative_to(out).as_posix() for kind, file in files.items()}


def _encode_npy(values: Array) -> bytes:
    stream = io.BytesIO()
    np.save(stream, values.astype(np.float32) if values.dtype.kind == "f" else values, allow_pickle=False)
    return stream.getvalue()


def _write_facts(workspace: Workspace, others: _OtherSuns, out: Path, key: str) -> None:
    """Write the facts of a pair, its left image and the maps from the true depth."""
    prepared, truth, grid = workspace.prepared, workspace.truth, workspace.grid
    folder = out / "pairs" / workspace.pair.name
    write_png(folder / "left.png", prepared.left)
    write_png(folder / "truth_sites.png", pictures.draw_failed_rules(truth, workspace.reached))
    write_bytes(folder / "truth_dem.tif", truth.dem.encode_geotiff(workspace.pair.data.get("ground")))
    write_bytes(folder / "truth_dem.npy", _encode_npy(truth.dem.height_m))
    write_bytes(folder / "truth_suitability.npy", _encode_npy(truth.sites.margin))
    write_bytes(folder / "reach.npy", _encode_npy(workspace.reached))
    files = {
        "left": "left.png",
        "truth": "truth_sites.png",
        "truth_tif": "truth_dem.tif",
        "truth_dem": "truth_dem.npy",
        "truth_suitability": "truth_suitability.npy",
        "reach": "reach.npy",
    }
    write_json(
        folder / "decisions.json",
        {
            "pair": workspace.pair.name,
            "scene": name_series(prepared.facts["settings"]),
            "site": name_site(prepared.facts["settings"]),
            "key": key,
            "exact": workspace.exact,
            "arm": has_arm(workspace.pair.settings),
            "joints": read_stated_joints(workspace.pair),
            "cell_m": grid.cell_m,
            "rows": grid.rows,
            "columns": grid.columns,
            "origin_m": [grid.west_m, grid.north_m],
            "sun_elevation_deg": elevation_deg(read_sun_direction(workspace.pair)),
            "excavation": _read_excavation_facts(workspace),
            "render_seed": workspace.pair.data.get("seeds", {}).get("render"),
            "height_px": int(prepared.left.shape[0]),
            "suspect": not (prepared.check.ok and others.agree),
            **({} if others.facts else {"noise": prepared.facts.get("noise")}),
            "images": {kind: (folder / file).relative_to(out).as_posix() for kind, file in files.items()},
            **({"suns": [*others.facts, _describe_sun(prepared)]} if others.facts else {}),
        },
    )


def _read_facts(out: Path, pair: str) -> dict[str, Any] | None:
    try:
        found: dict[str, Any] = read_record(out / "pairs" / pair / "decisions.json", _FACTS_SHAPE, "decide again")
    except (OSError, IcyMoonError):
        return None
    return found
