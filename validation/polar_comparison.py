"""Compares the labels of photographs with renders of the rebuilt scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from ..stereo.images.image_files import write_png
from ..stereo.images.masks import compute_intersection_over_union, fill_polygons
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from .comparison import Bench, Row
from .polar.camera import Calibration, fit_camera
from .polar.data_set import (
    DATA_ADVICE,
    EYES,
    GROUND,
    ROCK,
    SHADOW,
    SURVEYED_BASELINE_M,
    SURVEYED_LAMPS,
    Terrain,
    View,
    read_terrains,
)
from .polar.label_agreement import LabelAgreement, measure_label_agreement
from .polar.lamp import HeightTable, fit_lamps, trace_lamp_to_sand
from .polar.sand import Sand, assign_outlines, measure_sand
from .polar.scans import LeftOut, find_left_out
from .polar.scene import Frame, Masks, describe_scene, find_frame, read_twin, write_ground
from .polar_stereo import judge_stereo

#: Columns of the renders.
_RENDER_COLUMNS = 480
#: Columns of the renders of a quick run.
_QUICK_COLUMNS = 320
#: Least overlap of rocks.
_MIN_ROCK_OVERLAP = 0.85
#: Least overlap of shadows.
_MIN_SHADOW_OVERLAP = 0.75
#: Largest error of a shadow's length, as a share of it.
_MAX_TIP_ERROR = 0.02
#: Largest median distance of outlines in pixels.
_MAX_OUTLINE_ERROR_PX = 1.0
#: Largest error of the baseline in metres.
_MAX_BASELINE_ERROR_M = 0.01
#: Largest error of a lamp's place in metres.
_MAX_LAMP_ERROR_M = 0.3
#: Largest error of a rock's disparity in pixels.
_MAX_DISPARITY_ERROR_PX = 1.0
#: Least length in metres of a shadow whose tip is compared; shorter ones are lost between ripples of the sand.
_MIN_SHADOW_M = 0.15
#: Largest share of the outlined rocks without a scan. It is twice the share on terrain 04, whose 28 numbered rocks were
#: all scanned and have a mean share of 3.6 % each.
_MAX_UNSCANNED_SHARE = 0.02
#: Largest share of a photograph that may be shadow of the sand alone.
_MAX_SAND_SHADOW_SHARE = 0.005
_SOURCE = "POLAR-Sim's outlines by hand of NASA's photographs"
_SURVEY = "POLAR-Sim's survey"
_EYE_NAMES = {"L": "left", "R": "right"}
#: Colours of the pictures: rock, shadow, the rest.
_MASK_COLOURS = np.array([[70, 70, 80], [235, 235, 225], [20, 30, 140]], np.uint8)


@dataclass(frozen=True)
class Rebuilt:
    """A rebuilt terrain: its camera, its sand, the positions (3,) in metres of its lamps by azimuth, the unscanned
    objects in each photograph, and our rig at each position.
    """

    terrain: Terrain
    camera: Calibration
    sand: Sand
    lamps: dict[int, Array]
    left_out: dict[tuple[View, int], LeftOut]
    frames: dict[str, Frame]


def compare_terrains(bench: Bench) -> list[Row]:
    """Make the rows of every terrain in the folder. Raises IcyMoonError without a usable folder."""
    if bench.polar is None:
        raise IcyMoonError(f"No folder of the POLAR data is given; pass --polar FOLDER: {DATA_ADVICE}.")
    terrains = read_terrains(bench.polar)
    rows = [_compare_terrain(bench, terrain) for terrain in terrains]
    if len(terrains) == 1:
        return rows[0]
    return [
        replace(row, quantity=f"terrain {terrain.name}: {row.quantity}")
        for terrain, found in zip(terrains, rows, strict=True)
        for row in found
    ]


def _compare_terrain(bench: Bench, terrain: Terrain) -> list[Row]:
    camera = fit_camera(terrain)
    sand = measure_sand(terrain)
    lamps, sand = fit_lamps(terrain, camera, sand)
    left_out = {(view, azimuth): find_left_out(terrain, camera, view, azimuth) for view, azimuth in terrain.photographs}
    masks, frames = _render_masks(bench, terrain, camera, sand, lamps, left_out)
    _write_pictures(bench.folder / f"terrain{terrain.name}", terrain, masks)
    return judge_terrain(Rebuilt(terrain, camera, sand, lamps, left_out, frames), masks)


def judge_terrain(built: Rebuilt, masks: dict[tuple[View, int], Masks]) -> list[Row]:
    """Make the rows of a rebuilt terrain from the masks of its twins."""
    terrain, camera, sand, lamps = built.terrain, built.camera, built.sand, built.lamps
    return [
        *_make_camera_rows(camera),
        *_make_lamp_rows(lamps),
        *_make_unscanned_rows(terrain, built.left_out),
        *_make_own_shadow_rows(terrain, masks),
        *_mask_rows(terrain, masks, measure_label_agreement(terrain, camera, sand)),
        *_make_shadow_tip_rows(terrain, camera, sand, lamps),
        *_make_disparity_rows(terrain, camera, sand, built.frames),
        *judge_stereo(terrain, camera, built.frames, masks),
    ]


def _render_masks(
    bench: Bench,
    terrain: Terrain,
    camera: Calibration,
    sand: Sand,
    lamps: dict[int, Array],
    left_out: dict[tuple[View, int], LeftOut],
) -> tuple[dict[tuple[View, int], Masks], dict[str, Frame]]:
    """Render the masks of every photograph: for each position and azimuth, a stereo pair with the rocks and one without
    them. Returns the masks by photograph, and our rig by position."""
    columns = _QUICK_COLUMNS if bench.quick else _RENDER_COLUMNS
    frames = {position: find_frame(terrain, camera, sand, position, columns) for position in terrain.positions}
    described, cases = [], []
    for position, frame in frames.items():
        meshes = write_ground(bench.folder / f"terrain{terrain.name}", frame, sand, terrain.rocks)
        azimuths = sorted({azimuth for view, azimuth in terrain.photographs if view.position == position})
        for kept in (True, False):  # the same ground is built once if its pairs follow each other
            described += [describe_scene(frame, lamps[azimuth], meshes[kept]) for azimuth in azimuths]
            cases += [(position, azimuth, kept) for azimuth in azimuths]
    pairs = dict(zip(cases, bench.render(described), strict=True))
    found = {}
    for view, azimuth in terrain.photographs:
        frame = frames[view.position]
        twin = read_twin(pairs[view.position, azimuth, True], pairs[view.position, azimuth, False], view.eye)
        bare = left_out[view, azimuth]
        rock, shadow, ground, unknown = (
            fill_polygons(frame.shape, [frame.rectify(camera, view.eye, each) for each in outlines], finer=5)
            for outlines in (
                *(terrain.polygons(view, azimuth, kind) for kind in (ROCK, SHADOW, GROUND)),
                [*bare.rocks, *bare.shadows],
            )
        )
        # Around the sandbox are walls, which are not built.
        judged = (ground | rock | shadow | (not ground.any())) & ~unknown
        found[view, azimuth] = Masks(
            rock & judged, shadow & ~rock & judged, twin.rock & judged, twin.shadow & judged, judged, twin
        )
    return found, frames


def _make_camera_rows(camera: Calibration) -> list[Row]:
    return [
        Row(
            "camera: median distance of outlines from rocks",
            camera.median_px,
            0.0,
            _MAX_OUTLINE_ERROR_PX,
            _SOURCE,
            "px",
            fitted=True,
        ),
        Row("camera: baseline", camera.baseline_m, SURVEYED_BASELINE_M, _MAX_BASELINE_ERROR_M, _SURVEY, "m"),
    ]


def _make_lamp_rows(lamps: dict[int, Array]) -> list[Row]:
    return [
        Row(
            f"lamp at {azimuth}°: distance from the survey",
            float(np.linalg.norm((lamp - SURVEYED_LAMPS[azimuth])[:2])),
            0.0,
            _MAX_LAMP_ERROR_M,
            _SURVEY,
            "m",
            fitted=True,
        )
        for azimuth, lamp in lamps.items()
    ]


def _make_unscanned_rows(terrain: Terrain, left_out: dict[tuple[View, int], LeftOut]) -> list[Row]:
    """Make rows of the share of outlined rocks without a scan, which would reveal a missing scan."""
    return [
        Row(
            f"outlined rocks without a scan, position {position}: share of the area",
            float(np.mean([each.share for (view, _), each in left_out.items() if view.position == position])),
            0.0,
            _MAX_UNSCANNED_SHARE,
            _SOURCE,
        )
        for position in terrain.positions
    ]


def _make_own_shadow_rows(terrain: Terrain, masks: dict[tuple[View, int], Masks]) -> list[Row]:
    """Make rows of the share of sand that is dark without rocks, because fitted hollows must not cast the shadows of
    the photographs."""
    return [
        Row(
            f"shadow of the sand without rocks, position {position}: largest share of a photograph",
            max(
                float(np.mean(each.twin.own_shadow[each.judged]))
                for (view, _), each in masks.items()
                if view.position == position
            ),
            0.0,
            _MAX_SAND_SHADOW_SHARE,
            "no shadow of the sand is outlined",
        )
        for position in terrain.positions
    ]


def _mask_rows(terrain: Terrain, masks: dict[tuple[View, int], Masks], hand: LabelAgreement) -> list[Row]:
    rows = []
    for position in terrain.positions:
        rows += _make_overlap_rows(
            "rocks",
            position,
            masks,
            lambda each: compute_intersection_over_union(each.our_rock, each.rock),
            _MIN_ROCK_OVERLAP,
            _label_agreement_text(hand.rocks[position]),
        )
    for position in terrain.positions:
        rows += _make_overlap_rows(
            "shadows",
            position,
            masks,
            lambda each: compute_intersection_over_union(each.our_shadow, each.shadow),
            _MIN_SHADOW_OVERLAP,
            "The left eye's outlines, projected into the right eye over the fitted sand, agree with the right eye's to "
            f"{hand.shadows[position]:.2f}",
        )
    return rows


def _label_agreement_text(agreement: float) -> str:
    if np.isnan(agreement):
        return "No two lamps have separate outlines, so the agreement of outlines with themselves is unknown"
    return f"Outlines under one lamp agree with outlines drawn anew under another to {agreement:.2f}"


def _make_overlap_rows(
    name: str,
    position: str,
    masks: dict[tuple[View, int], Masks],
    agreement: Callable[[Masks], float],
    goal: float,
    why: str,
) -> list[Row]:
    return [
        Row(
            f"{name}, position {position}, {_EYE_NAMES[eye]} eye: intersection over union",
            float(np.mean([agreement(each) for (view, _), each in masks.items() if view == View(position, eye)])),
            1.0,
            1 - goal,
            _SOURCE,
            fitted=eye == "L",
            why=why,
        )
        for eye in EYES
    ]


def _make_shadow_tip_rows(terrain: Terrain, camera: Calibration, sand: Sand, lamps: dict[int, Array]) -> list[Row]:
    """Make rows of the lengths of shadows along the light, in the photographs of the right eyes."""
    reaches = _measure_reaches(terrain, camera, sand, lamps)
    errors = [1.0 / reach - 1.0 for (view, _, _), reach in reaches.items() if view.eye == "R"]
    if not errors:
        return []
    again = [
        f"by more than {apart:.1%} between {what}"
        for apart, what in zip(
            _compare_labelled_tips(reaches),
            ("the eyes of a position", "positions, by way of the fitted sand"),
            strict=True,
        )
        if np.isfinite(apart)
    ]
    quantity = f"tips of {len(errors)} shadows, right eyes: median"
    why = f"Half of the outlined tips differ {', and '.join(again)}" if again else ""
    return [
        Row(f"{quantity} error of the length", float(np.median(errors)), 0.0, _MAX_TIP_ERROR, _SOURCE, why=why),
        Row(f"{quantity} size of the error", float(np.median(np.abs(errors))), 0.0, _MAX_TIP_ERROR, _SOURCE, why=why),
    ]


_Reaches = dict[tuple[View, int, int], float]


def _measure_reaches(terrain: Terrain, camera: Calibration, sand: Sand, lamps: dict[int, Array]) -> _Reaches:
    """Measure the lengths of labelled shadows, as shares of the lengths of ours, by view, azimuth and index of the
    rock."""
    table, found = HeightTable(sand), {}
    visible = [sand.visible(rock) for rock in terrain.rocks]
    for view, azimuth in terrain.photographs:
        eye, lamp = camera.eyes[view], lamps[azimuth]
        outlines = terrain.polygons(view, azimuth, SHADOW)
        for k, (points, faces) in enumerate(visible):
            if not len(faces):
                continue
            top = points[np.unique(faces)]
            cast = trace_lamp_to_sand(top, lamp, table)
            away = sand.middles[k] - lamp[:2]
            along = (cast[:, :2] - sand.middles[k]) @ away / np.linalg.norm(away)
            if along.max() < _MIN_SHADOW_M:
                continue
            foot = np.array([*sand.middles[k], float(table(sand.middles[k][None])[0])])
            reach = _measure_labelled_reach(eye.project(np.stack([foot, cast[along.argmax()]])), outlines)
            if reach is not None:
                found[view, azimuth, k] = reach
    return found


def _compare_labelled_tips(reaches: _Reaches) -> tuple[float, float]:
    """Compute the median differences of labelled tips, as shares of their lengths: between the eyes, and between
    positions. NaN without any."""
    shadows: dict[tuple[int, int], dict[str, list[float]]] = {}
    for (view, azimuth, k), reach in reaches.items():
        shadows.setdefault((azimuth, k), {}).setdefault(view.position, []).append(reach)
    eyes = [abs(both[0] / both[1] - 1) for seen in shadows.values() for both in seen.values() if len(both) == len(EYES)]
    positions = [
        abs(float(np.mean(one) / np.mean(other)) - 1)
        for seen in shadows.values()
        for one, other in combinations(seen.values(), 2)
    ]
    return _median_or_nan(eyes), _median_or_nan(positions)


def _median_or_nan(values: list[float]) -> float:
    return float(np.median(values)) if values else float("nan")


def _measure_labelled_reach(ends: Array, outlines: list[Array]) -> float | None:
    """Measure the length of a labelled shadow from the foot toward our tip, as a share of the distance between both.
    None if no shadow is labelled there.

    The outline that contains the middle of our shadow counts. Shadows that run into the next one are left out.
    """
    foot, tip = ends
    way = tip - foot
    length = float(np.linalg.norm(way))
    across = np.array([-way[1], way[0]]) / length
    for outline in outlines:
        if not fill_polygons((1, 1), [outline - (foot + 0.6 * way) + 0.5])[0, 0]:
            continue
        along, beside = (outline - foot) @ way / length**2, np.abs((outline - foot) @ across)
        near = along[beside < 0.15 * length]
        if len(near) and 0.6 < near.max() < 1.6:
            return float(near.max())
    return None


def _make_disparity_rows(terrain: Terrain, camera: Calibration, sand: Sand, frames: dict[str, Frame]) -> list[Row]:
    """Make rows of the disparity of rocks: their outlines beside their scans, in pixels of the renders."""
    rows = []
    visible = [sand.visible(rock) for rock in terrain.rocks]
    for position, frame in frames.items():
        apart = []
        own = {
            eye: [assign_outlines(terrain, camera, sand, View(position, eye), azimuth) for azimuth in terrain.azimuths]
            for eye in EYES
        }
        for k, (points, faces) in enumerate(visible):
            middles = {
                eye: [
                    _middle_column(frame.rectify(camera, eye, found[k][0])) for found in own[eye] if len(found[k]) == 1
                ]
                for eye in EYES
            }
            if not len(faces) or not all(middles.values()):
                continue
            used = points[np.unique(faces)]
            theirs = np.median(middles["L"]) - np.median(middles["R"])
            ours = _middle_column(frame.project(used, "L")) - _middle_column(frame.project(used, "R"))
            apart.append(float(ours - theirs))
        if apart:
            rows.append(
                Row(
                    f"disparity of {len(apart)} rocks, position {position}: median size of the difference",
                    float(np.median(np.abs(apart))),
                    0.0,
                    _MAX_DISPARITY_ERROR_PX,
                    _SOURCE,
                    "px",
                )
            )
    return rows


def _middle_column(pixels: Array) -> float:
    return float(pixels[:, 0].min() + pixels[:, 0].max()) / 2


def _write_pictures(folder: Path, terrain: Terrain, masks: dict[tuple[View, int], Masks]) -> None:
    """Write a picture for each view: labels, our masks and our render side by side, one azimuth below the other."""
    for view in terrain.views:
        rows = []
        for azimuth in terrain.azimuths:
            if (each := masks.get((view, azimuth))) is None:
                continue
            white = max(float(np.quantile(each.twin.light, 0.98)), 1e-12)
            grey = np.repeat(
                (np.clip(each.twin.light / white, 0, 1) ** 0.5 * 255).astype(np.uint8)[..., None], 3, axis=2
            )
            rows.append(
                np.hstack(
                    [
                        _MASK_COLOURS[each.rock + 2 * each.shadow],
                        _MASK_COLOURS[each.our_rock + 2 * each.our_shadow],
                        grey,
                    ]
                )
            )
        write_png(folder / f"twins_{view.position}_{view.eye}.png", np.vstack(rows))
