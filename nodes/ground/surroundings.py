"""Ground around the patch of a height map, out to a stated distance, from its file and a coarser file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...formats.map_frame import MapFrame
from ...formats.map_heights import MapCover, MapPixels, convert_array_to_pixels, measure_levels, read_cover, read_means
from ...formats.map_surroundings import check_reach, find_body_radius_m, find_map_frame, plan_surroundings
from ...physics.camera.stereo_camera import StereoCamera
from ...physics.mesh.blend_maps import BlendedMaps, LevelMeans, blend_maps
from ...physics.mesh.height_map import HeightMap
from ...physics.mesh.heights_on_mesh import SurroundedGround
from ...physics.mesh.horizon import drop_m, horizon_m
from ...physics.mesh.nested_rings import Level, build_rings, drop_unknown_vertices
from ...physics.mesh.open_directions import find_open_directions
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.number_text import format_count

#: Width of the band in which the coarse map takes over: in pixels of that map, and at most a share of the fine map's
#: width.
_BAND_PIXELS, _BAND_SHARE = 2.0, 0.25
#: Minimum margin around the patch that holds the whole band, as a share of the fine map's width.
_MIN_MARGIN = 1 / 16
#: Width in pixels of squares of the last map. A square counts if half of it is known, so there is ground up to half
#: this width from known pixels.
_GAP_PIXELS = 16.0
#: Offset between two maps that gives a warning: a tenth of a coarse pixel, and at least a metre.
_OFFSET_PIXELS, _MIN_OFFSET_M = 0.1, 1.0
#: Numbers of directions in which the end of the ground is searched: all around the site, and in the view.
_ALL_AROUND, _IN_VIEW = 360, 91


@dataclass(frozen=True)
class MapOfSite:
    """A height map that was read for a site. ``values`` (rows, columns) are heights in metres above z = 0, NaN where
    missing, and ``whole`` tells whether they are the whole map. ``zero_m`` is the file's height in metres at z = 0, and
    ``missing`` the stated value that means no height in both maps."""

    path: Path
    whole: bool
    values: Array
    surface: HeightMap
    zero_m: float
    missing: float | None = None


@dataclass(frozen=True)
class SurroundedMesh:
    """The ground of a patch with its surroundings, lines for the import report, and warnings."""

    surface: SurroundedGround
    report: tuple[str, ...]
    warnings: tuple[str, ...]


def surround(of: MapOfSite, coarse: Path | None, settings: Settings) -> SurroundedMesh:
    """Make the ground of a site with its surroundings, from its map and, if given, a ``coarse`` map.

    Raises IcyMoonError for maps that cannot be laid around the site.
    """
    frame = find_map_frame(of.path, settings)
    _refuse_without_map(of, coarse, frame)
    warnings = check_reach(settings, frame, of.path.name)
    pixels = _hold_pixels(of)
    covers = [pixels.cover if pixels is not None else read_cover(of.path, _require_frame(frame))]
    if coarse is not None and frame is not None:
        covers.append(read_cover(coarse, frame))
    levels = plan_surroundings(settings, covers)
    gap_m, alone = _GAP_PIXELS * covers[-1].pixel_m, len(covers) == 1
    wide_m = gap_m if alone else 2.0 * _choose_band_m(covers, float(settings.terrain.size_m))
    fine, said = _measure_fine(of, pixels, frame, levels, wide_m, settings)
    if alone:  # the patch is the same as without surroundings, even with gaps
        west, east, south, north = of.surface.bounds_m
        x, y = levels[0].axis_m[None, :], levels[0].axis_m[:, None]
        inside = (x >= west) & (x <= east) & (y >= south) & (y <= north)
        fine[0] = LevelMeans(fine[0].heights_m, np.where(inside, 1.0, fine[0].share))
    others: list[LevelMeans] | None = None
    if coarse is not None and frame is not None:
        others, told = _read_means(coarse, of, frame, levels, gap_m)
        said += told
    blended = blend_maps(levels, fine, others)
    warnings += said + _judge_offset(of, coarse, blended, covers)
    radius_m = find_body_radius_m(settings, frame)
    warnings += _warn_of_end(settings, levels, blended.heights_m, radius_m)
    surface = _build(levels, blended.heights_m, radius_m)
    return SurroundedMesh(
        surface, tuple(_describe_surroundings(levels, coarse, blended, wide_m, radius_m)), tuple(warnings)
    )


def _refuse_without_map(of: MapOfSite, coarse: Path | None, frame: MapFrame | None) -> None:
    """Raise IcyMoonError for a map without a position, because no second map can be placed beside it."""
    if frame is not None:
        return
    if coarse is not None:
        raise IcyMoonError(
            f"source.surroundings_file lies on a map, but {of.path.name} states no coordinate system; give a GeoTIFF "
            "that states one, with source.metres_per_pixel 0, or leave source.surroundings_file empty."
        )
    if not of.whole:
        raise IcyMoonError(
            f"{of.path.name} states no coordinate system, and only its part around the site was read; state it in its "
            "folder with: gdal_edit.py -a_srs SYSTEM, or set source.surroundings_m to 0."
        )


def _require_frame(frame: MapFrame | None) -> MapFrame:
    """Return the frame of a map that ``_refuse_without_map`` has accepted."""
    assert frame is not None
    return frame


def _hold_pixels(of: MapOfSite) -> MapPixels | None:
    """Return the pixels of a map that is completely in memory; None for another map."""
    if not of.whole:
        return None
    return convert_array_to_pixels(of.values, of.surface.pixel_m, of.surface.west_m, of.surface.south_m)


def _choose_band_m(covers: list[MapCover], size_m: float) -> float:
    """Choose the width in metres of the band inside the fine map's edge in which the coarse map takes over. The band
    lies beside the patch if there is room."""
    fine, coarse = covers
    width_m = fine.farthest_m + fine.nearest_m
    band_m = min(_BAND_PIXELS * coarse.pixel_m, _BAND_SHARE * max(width_m, 0.0))
    margin_m = fine.nearest_m - size_m / 2
    return min(band_m, margin_m) if margin_m > _MIN_MARGIN * width_m else band_m


def _measure_fine(
    of: MapOfSite,
    pixels: MapPixels | None,
    frame: MapFrame | None,
    levels: list[Level],
    wide_m: float,
    settings: Settings,
) -> tuple[list[LevelMeans], list[str]]:
    """Measure the heights of the fine map at each level. Return them, and sentences for the user. The patch has the
    same heights as without surroundings."""
    if pixels is not None:
        means = measure_levels(pixels, levels, wide_m)
        said: list[str] = []
    else:
        scale = float(settings.source.height_scale_m)
        means, said = _read_means(of.path, of, _require_frame(frame), levels, wide_m, scale)
    axis = levels[0].axis_m
    heights = of.surface.heights(axis[None, :], axis[:, None], 2 * levels[0].cell_m)
    patch = np.where(np.isfinite(heights), heights, means[0].heights_m)
    return [LevelMeans(patch, means[0].share), *means[1:]], said


def _read_means(
    path: Path, of: MapOfSite, frame: MapFrame, levels: list[Level], wide_m: float, height_scale: float = 1.0
) -> tuple[list[LevelMeans], list[str]]:
    """Read the heights of a file at each level, above z = 0 of the site's map, and sentences for the user; see
    ``read_means``."""
    found = read_means(path, frame, levels, wide_m, of.missing, height_scale)
    means = [LevelMeans(each.heights_m - of.zero_m, each.share) for each in found.levels]
    return means, [f"{path.name}: {sentence}." for sentence in found.warnings]


def _judge_offset(of: MapOfSite, coarse: Path | None, blended: BlendedMaps, covers: list[MapCover]) -> list[str]:
    """Return a warning if the mean offset between two maps, or their RMS difference without it, suggests other height
    systems or places; otherwise nothing."""
    if coarse is None or blended.offset_m is None or blended.apart_m is None:
        return []
    most_m = max(_MIN_OFFSET_M, _OFFSET_PIXELS * covers[1].pixel_m)
    if abs(blended.offset_m) <= most_m and blended.apart_m <= most_m:
        return []
    return [
        f"Where {of.path.name} is blended into {coarse.name}, it is {abs(blended.offset_m):.4g} m "
        f"{'higher' if blended.offset_m > 0 else 'lower'} on average; {coarse.name} was moved by this offset. After "
        f"that, the two differ by {blended.apart_m:.3g} m (RMS). More than {most_m:.3g} m suggests that their height "
        "systems or places differ; check both."
    ]


def _warn_of_end(settings: Settings, levels: list[Level], heights_m: list[Array], radius_m: float) -> list[str]:
    """Return a warning if the ground ends before the horizon."""
    rig = settings.rig
    camera = StereoCamera.from_settings(rig)
    half_deg = math.degrees(math.atan2(camera.rendered_px[0] / 2, camera.focal_px))
    to_m, eye = horizon_m(float(rig.height_m), radius_m), (float(rig.x_m), float(rig.y_m))
    around, seen = (
        float(find_open_directions(levels, heights_m, eye, azimuths, to_m).mean())
        for azimuths in (
            np.arange(_ALL_AROUND) * 360.0 / _ALL_AROUND,
            float(rig.heading_deg) + np.linspace(-half_deg, half_deg, _IN_VIEW),
        )
    )
    if around == 0.0 and seen == 0.0:
        return []
    fix = (
        f"raise source.surroundings_m to {math.ceil(to_m + math.hypot(*eye))} or more"
        if to_m > levels[-1].half_m
        else "give a source.surroundings_file that reaches farther"
    )
    return [
        f"The ground ends before the horizon, which is {to_m:.4g} m away, in {around:.0%} of all directions and in "
        f"{seen:.0%} of the view's; {fix}."
    ]


def _build(levels: list[Level], heights_m: list[Array], radius_m: float) -> SurroundedGround:
    mesh = build_rings(levels)
    heights = np.concatenate([each[level.find_ring_vertices()] for level, each in zip(levels, heights_m, strict=True)])
    curved = heights - drop_m(np.hypot(mesh.places[:, 0], mesh.places[:, 1]), radius_m)
    positions, faces = drop_unknown_vertices(mesh, curved)
    return SurroundedGround(positions, faces, 2 * levels[0].half_m, levels[0].cell_m, radius_m)


def _describe_surroundings(
    levels: list[Level], coarse: Path | None, blended: BlendedMaps, wide_m: float, radius_m: float
) -> list[str]:
    """Describe the surroundings in sentences for the import report."""
    last = levels[-1]
    said = [
        f"Ground goes on to {last.half_m:.6g} m in {format_count(len(levels) - 1, 'ring')}, with cells of "
        f"{levels[0].cell_m:.3g} to {last.cell_m:.3g} m, on a body with a radius of {radius_m / 1000:.6g} km"
    ]
    if coarse is not None:
        said.append(f"Beyond the map its heights are those of {coarse.name}, blended over {wide_m / 2:.4g} m")
    if blended.offset_m is not None and blended.apart_m is not None and coarse is not None:
        said.append(
            f"{blended.offset_m:.4g} m were added to {coarse.name}; after that the two differ by "
            f"{blended.apart_m:.3g} m (RMS)"
        )
    return said
