"""The design of a study: a TOML file, and the pairs that it determines.

``[study]`` has a title, the question, presets to ``include``, the ``methods``, two recipes that are the halves of the
converged render (``reference``), and the recipes whose ``noise`` is judged. A view counts if its noise over the mean
light is at most ``reference_noise``. ``[settings]`` hold for all views. Each ``[[ground]]`` is seen under its Suns, one
in each round; each ``[[recipe]]`` renders every view. ``[[comparison]]`` and ``[[hypothesis]]`` name two recipes, or a
recipe and ``converged``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...render.plans.planned_pair import PlannedPair, expand_headings
from ...settings.description import check, defaults, merged
from ...settings.preset_files import load_preset
from ...settings.toml_text import read_toml_and_text
from ...settings.topics.scene import Settings
from ...support.errors import IcyMoonError
from ...support.file_schemas import FILE_NAME, NUMBER, TABLE, TEXT, Each, Maybe, check_record
from ...support.suggestions import suggest_nearest
from ..trade.measure_variants import scale_view

#: The name of the mean of both halves in comparisons.
CONVERGED = "converged"
_COMPARE_WITH_SHIPPED = "compare it with the shipped studies"
#: A ground and a recipe also have settings, besides these keys.
_STUDY_SHAPE = {
    "study": {
        "title": TEXT,
        "question": TEXT,
        "include": Each(TEXT),
        "methods": TEXT,
        "scale": Maybe(NUMBER),
        "reference": Each(TEXT),
        "reference_noise": NUMBER,
        "noise": Each(TEXT),
    },
    "settings": TABLE,
    "ground": Each({"preset": TEXT, "suns_deg": Each(NUMBER), "name": Maybe(FILE_NAME), "scale": Maybe(NUMBER)}),
    "recipe": Each({"name": TEXT, "title": TEXT, "preset": Maybe(TEXT)}),
    "comparison": Each({"of": TEXT, "with": TEXT}),
    "hypothesis": Maybe(
        Each(
            {
                "says": TEXT,
                "of": TEXT,
                "with": TEXT,
                "what": TEXT,
                "above": Maybe(NUMBER),
                "below": Maybe(NUMBER),
                "within": Maybe(NUMBER),
            }
        )
    ),
}


@dataclass(frozen=True)
class StudyView:
    """A ground under a Sun: its name, the round in which it is rendered, and its complete settings without a recipe."""

    name: str
    ground: str
    round: int
    settings: Settings


@dataclass(frozen=True)
class Recipe:
    """A way to render a view: the settings that it changes."""

    name: str
    title: str
    changes: Settings


@dataclass(frozen=True)
class Hypothesis:
    """The expected typical change, from ``low`` to ``high`` points, of ``what``: an error such as ``bm``, or a gap such
    as ``jplv - bm``.
    """

    says: str
    of: str
    against: str
    what: str
    low: float
    high: float


@dataclass(frozen=True)
class Study:
    """The content of a study's file."""

    text: str
    title: str
    question: str
    methods: str
    views: tuple[StudyView, ...]
    recipes: tuple[Recipe, ...]
    reference: tuple[str, str]
    reference_noise: float
    noise: tuple[str, ...]
    comparisons: tuple[tuple[str, str], ...]
    hypotheses: tuple[Hypothesis, ...]

    def pairs_of(self, view: StudyView) -> dict[str, PlannedPair]:
        """Make the pair of each recipe for a view."""
        return {recipe.name: expand_headings(merged(view.settings, recipe.changes))[0] for recipe in self.recipes}

    def rounds(self) -> list[list[StudyView]]:
        """List the views of each round."""
        return [[view for view in self.views if view.round == k] for k in sorted({view.round for view in self.views})]


def list_study_names() -> list[str]:
    """List the names of the shipped studies."""
    return sorted(path.stem for path in Path(__file__).parent.glob("*.toml"))


def find_study(name: str) -> Path:
    """Find the file of a shipped study by its name, or the user's file if the name ends in .toml. Raises IcyMoonError
    for an unknown name.
    """
    if name.endswith(".toml"):
        return Path(name)
    if name not in list_study_names():
        raise IcyMoonError(f"There is no study {name!r}, {suggest_nearest(name, list_study_names())}")
    return Path(__file__).parent / f"{name}.toml"


def read_study(path: Path) -> Study:
    """Read and check a study. Raises IcyMoonError that names the file and the fault."""
    data, text = read_toml_and_text(path)
    check_record(data, _STUDY_SHAPE, path, _COMPARE_WITH_SHIPPED)
    head = data["study"]
    recipes = tuple(
        Recipe(table["name"], table["title"], _read_settings(table, ("name", "title"), path))
        for table in data["recipe"]
    )
    names = [recipe.name for recipe in recipes]
    if len(head["reference"]) != 2 or len(set(names)) < len(names):
        raise IcyMoonError(
            f"{path}: a study has two halves of its reference, and recipes of different names; {_COMPARE_WITH_SHIPPED}."
        )
    for name in (*head["reference"], *head["noise"]):
        _check_name(name, names, path)
    for table in (*data["comparison"], *data.get("hypothesis", [])):
        for side in ("of", "with"):
            _check_name(table[side], [CONVERGED, *names], path)
    base = merged(defaults(), *map(load_preset, head["include"]))
    common = check(data["settings"], str(path))
    return Study(
        text,
        head["title"],
        head["question"],
        head["methods"],
        tuple(
            StudyView(f"{name}_{sun:g}", name, k, _set_view(merged(base, part, common), sun, scale))
            for name, part, suns, scale in _read_grounds(data["ground"], head, path)
            for k, sun in enumerate(suns)
        ),
        recipes,
        (head["reference"][0], head["reference"][1]),
        float(head["reference_noise"]),
        tuple(head["noise"]),
        tuple((table["of"], table["with"]) for table in data["comparison"]),
        tuple(_read_hypothesis(table, path) for table in data.get("hypothesis", [])),
    )


def _read_grounds(
    tables: Sequence[Mapping[str, Any]], head: Mapping[str, Any], path: Path
) -> list[tuple[str, Settings, list[float], float]]:
    """Read the name, the settings, the Suns and the scale of each ground."""
    return [
        (
            table.get("name") or table["preset"].split("/")[-1],
            _read_settings(table, ("name", "suns_deg", "scale"), path),
            table["suns_deg"],
            float(table.get("scale", head.get("scale", 1.0))),
        )
        for table in tables
    ]


def _read_settings(table: Mapping[str, Any], known: Sequence[str], path: Path) -> Settings:
    """Read the settings of a table's preset, overridden by the table's other settings."""
    own = check({key: value for key, value in table.items() if key not in (*known, "preset")}, str(path))
    return merged(load_preset(table["preset"]), own) if table.get("preset") else own


def _set_view(settings: Settings, sun_deg: float, scale: float) -> Settings:
    return scale_view(merged(settings, {"light": {"sun_elevation_deg": float(sun_deg)}}), scale)


def _check_name(name: str, known: Sequence[str], path: Path) -> None:
    if name not in known:
        raise IcyMoonError(f"{path}: there is no recipe {name!r}, {suggest_nearest(name, known)}")


def _read_hypothesis(table: Mapping[str, Any], path: Path) -> Hypothesis:
    """Read the range of a hypothesis from exactly one of ``above``, ``below`` and ``within``."""
    ranges: dict[str, Callable[[float], tuple[float, float]]] = {
        "above": lambda bound: (bound, float("inf")),
        "below": lambda bound: (float("-inf"), bound),
        "within": lambda bound: (-bound, bound),
    }
    stated = [key for key in ranges if key in table]
    if len(stated) != 1:
        raise IcyMoonError(f"{path}: {table['says']!r} states {len(stated)} ranges; give above, below or within.")
    low, high = ranges[stated[0]](float(table[stated[0]]))
    return Hypothesis(table["says"], table["of"], table["with"], table["what"], low, high)
