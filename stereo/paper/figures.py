"""The figures of the GUISS paper: depth of each method, error against albedo, and sheets with grids of images."""

from __future__ import annotations

import tempfile
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from ...render.pairs.pair_folder import Pair, is_complete, read_pair
from ...render.plans.planned_pair import PlannedPair
from ...support.arrays import Array
from ...support.files import write_bytes
from ...support.labels import TERRAIN
from ..images.gallery import find_automatic_white, read_radiance, to_screen_picture, write_sheet
from ..images.image_files import read_png
from ..images.views import read_eye
from ..matchers.methods import describe_method
from ..report.by_setting import find_swept_settings
from ..report.conditions import join_by_scene, make_pair_titles, name_levels
from ..report.pictures import apply_screen_gamma, find_typical_pair
from ..report.summary import summarise_method
from ..report.sweep_charts import SweepCharts, draw_sweeps, write_curves
from .results import PaperResults

#: For each figure: the columns of its sheet, its title, and its subject.
SHEETS = {
    "ruggedness": (4, "Ruggedness", "Terrains in place of the paper's, from low to very high."),
    "subsurface": (3, "Light under the surface and transmission", "Rows: its share. Columns: transmission."),
    "texture": (6, "Albedo, gloss and noise", "Rows: albedo. Columns: specular level, without and with dark patches."),
    "suns": (5, "Directions of the Sun", "Smooth and rugged ground under the paper's five lamps."),
    "rocks": (3, "Rocks with masks", "Image, semantic mask and instance mask of two densities and two sizes."),
}
#: Width of a picture on a sheet, px, and most letters of a title and of a line below it.
_CELL_PX, _TITLE_LETTERS, _LINE_LETTERS = 320, 33, 42
_MAX_BYTES = 1_000_000
#: The setting of the albedo figure.
_ALBEDO_SETTING = "surface.albedo"
#: Grey of the ground in masks, number of hues, and step in the circle of hues from one label to the next. With this
#: step a hue is rarely repeated.
_GROUND_GREY, _HUE_COUNT, _HUE_STEP = 90, 180, 0.618034


def write_qualitative(measured: PaperResults, sets: Mapping[str, Sequence[PlannedPair]], file: Path) -> list[str]:
    """Write a sheet with a typical pair of each set: image, true depth and the depth of each method. Return the pairs'
    names, [] if no pair has a result.
    """
    cells: list[tuple[Path | Array, str, str]] = []
    shown = []
    for title, pairs in sets.items():
        names = {pair.id for pair in pairs}
        number = find_typical_pair(measured.table, np.array([name in names for name in measured.table.pairs]))
        if number is None:
            continue
        facts, name = measured.facts[number], measured.table.pairs[number]
        shown.append(name)
        cells.append((apply_screen_gamma(read_png(measured.out / facts["images"]["left"])), title.capitalize(), name))
        cells.append((measured.out / facts["images"]["true_depth"], "True depth", ""))
        for matcher in measured.table.methods:
            images = measured.row(name, matcher)["images"]
            blank = np.zeros((facts["height_px"], facts["width_px"]), np.uint8)
            picture = measured.out / images["depth"] if "depth" in images else blank
            cells.append((picture, describe_method(matcher), "" if "depth" in images else "failed"))
    if cells:
        write_sheet(cells, file, _MAX_BYTES, 2 + len(measured.table.methods), _CELL_PX)
    return shown


def draw_albedo(measured: PaperResults, name: str, out: Path) -> SweepCharts | None:
    """Draw the charts of the errors against the albedo of the pairs, and write them to ``NAME.png`` in ``out``. None if
    all albedos are equal.
    """
    places = {pair["pair"]: k for k, pair in enumerate(measured.facts)}
    sweeps = [sweep for sweep in find_swept_settings(measured.facts, places) if sweep.name == _ALBEDO_SETTING]
    if not sweeps:
        return None
    table = measured.table
    summary = [summarise_method(table, k) for k in range(len(table.methods))]
    with tempfile.TemporaryDirectory(prefix="icymoon-paper-") as folder:
        picture = Path(folder, write_curves(summary, table, sweeps, Path(folder))[_ALBEDO_SETTING])
        write_bytes(out / f"{name}.png", picture.read_bytes())
    return draw_sweeps(summary, table, sweeps)[0]


def write_figure_sheet(name: str, pairs: Sequence[PlannedPair], dataset: Path, file: Path) -> bool:
    """Write the sheet of a figure: the images of its pairs, all at one exposure, and the masks of rocks. Return False
    if no pair is rendered.
    """
    there = [pair for pair in pairs if is_complete(pair.folder(dataset))]
    if not there:
        return False
    facts = [{"pair": pair.id, "settings": pair.settings} for pair in there]
    places = {pair.id: k for k, pair in enumerate(there)}
    sweeps = join_by_scene(find_swept_settings(facts, places), facts, places)
    titles = make_pair_titles(sweeps, name_levels(sweeps, facts, places), len(there))
    rendered = [read_pair(pair.folder(dataset)) for pair in there]
    white = max(find_automatic_white(read_radiance(pair), pair) for pair in rendered)
    cells: list[tuple[Path | Array, str, str]] = []
    for pair, title in zip(rendered, titles, strict=True):
        cells.append((to_screen_picture(read_radiance(pair), white), *wrap_caption(title)))
        if name == "rocks":
            cells += _draw_masks(pair)
    columns, _, _ = SHEETS[name]
    write_sheet(cells, file, _MAX_BYTES, columns, _CELL_PX)
    return True


def wrap_caption(text: str) -> tuple[str, str]:
    """Wrap a text to a title and lines below it that fit under a picture of a sheet, without omissions."""
    first, *_ = textwrap.wrap(_to_ascii(text), _TITLE_LETTERS) or [""]
    rest = _to_ascii(text)[len(first) :].strip()
    return first, textwrap.fill(rest, _LINE_LETTERS)


def _to_ascii(text: str) -> str:
    """Write a text in the letters that OpenCV draws."""
    return text.replace("°", " deg").encode("ascii", "ignore").decode()


def _draw_masks(pair: Pair) -> list[tuple[Array, str, str]]:
    _, view = read_eye(pair, "left")
    return [
        (colour_labels(labels), title, "")
        for labels, title in ((view.semantic, "Semantic mask"), (view.instance, "Instance mask"))
        if labels is not None
    ]


def colour_labels(labels: Array) -> Array:
    """Draw labels (H, W) as a picture (H, W, 3), blue first: the sky black, the terrain grey, any other label in its
    own hue.
    """
    hue = np.rint(_HUE_COUNT * (labels.astype(np.float64) * _HUE_STEP % 1.0)).astype(np.uint8) % _HUE_COUNT
    full = np.full_like(hue, 255)
    shown = cv2.cvtColor(np.stack([hue, full, full], axis=-1), cv2.COLOR_HSV2BGR)
    shown[labels == 0] = 0
    shown[labels == TERRAIN] = _GROUND_GREY
    return np.asarray(shown)
