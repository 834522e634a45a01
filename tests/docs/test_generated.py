"""The pages and figures that the repository keeps are those that its code gives now."""

from __future__ import annotations

import re
import sys

import manual
import pytest
from icymoon.support.version import ROOT

sys.path.insert(0, str(ROOT / "docs" / "make"))
import notebooks
import reference

STALE = "differs from what the code gives now; run `make docs-pages` and commit it"
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
#: Of a point. Figures are rounded to hundredths, and another processor may round the last digit the other way.
TOLERANCE = 0.02
#: It counts errors in the last bits, of which each NumPy and each processor has its own.
OF_LAST_BITS = "hapke_error"


def kept(path: str) -> str:
    """Text of a generated file as the repository keeps it; empty if it is not there."""
    file = ROOT / path
    return file.read_text(encoding="utf-8") if file.is_file() else ""


@pytest.mark.parametrize("page", sorted(manual.generated()))
def test_a_page_is_what_the_code_gives(page):
    assert kept(page) == manual.generated()[page], f"{page} {STALE}"


def test_a_page_tells_how_it_is_made():
    for page, text in manual.generated().items():
        assert text.startswith(reference.HEADER), page
    assert "make docs-pages" in reference.HEADER
    assert "\ndocs-pages:" in (ROOT / "Makefile").read_text(encoding="utf-8")


def test_the_figures_of_notebooks_are_those_of_their_outputs():
    for path, content in notebooks.images().items():
        assert (ROOT / "docs" / path).read_bytes() == content, f"docs/{path} {STALE}"


def figure_fault(text: str, other: str) -> str:
    """What differs between two drawings, beside their last digits."""
    if _NUMBER.sub("#", text) != _NUMBER.sub("#", other):
        return "other shapes or words"
    off = max(
        (abs(float(a) - float(b)) for a, b in zip(_NUMBER.findall(text), _NUMBER.findall(other), strict=True)),
        default=0.0,
    )
    return f"{off:g} pt off" if off > TOLERANCE else ""


def test_another_drawing_is_found():
    assert not figure_fault('<path d="M 1.5 2"/>', '<path d="M 1.51 2"/>')
    assert figure_fault('<path d="M 1.5 2"/>', '<path d="M 1.6 2"/>') == "0.1 pt off"
    assert figure_fault('<path d="M 1.5 2"/>', '<path d="L 1.5 2"/>') == "other shapes or words"


def figure_names() -> list[str]:
    """The figures, by the functions that draw them: their module needs Matplotlib."""
    source = (ROOT / "docs" / "make" / "figures.py").read_text(encoding="utf-8")
    return re.findall(r"(?m)^def (\w+)\(figure: Figure\)", source)


@pytest.mark.ci_takes(3)
@pytest.mark.heavy
@pytest.mark.parametrize("name", figure_names())
def test_a_figure_is_what_the_code_draws(name):
    matplotlib = pytest.importorskip("matplotlib")
    import figures

    assert set(figure_names()) == set(figures.FIGURES)
    path = f"docs/figures/{name}.svg"
    if name == OF_LAST_BITS:
        assert kept(path), f"{path} is missing; run `make docs-pages` and commit it"
        return
    if f"Matplotlib v{matplotlib.__version__}," not in kept(path) and kept(path):
        pytest.skip(f"{path} was drawn by another Matplotlib; constraints/tests.txt states which")
    assert not (fault := figure_fault(figures.svg(name).decode(), kept(path))), f"{path} {STALE}: {fault}"


def test_no_file_is_left_of_a_page_or_figure_that_is_gone():
    drawn = {f"{name}.svg" for name in figure_names()}
    assert {path.name for path in (ROOT / "docs" / "figures").iterdir()} == drawn
    marked = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "docs").rglob("*.md")
        if path.read_text(encoding="utf-8").startswith(reference.HEADER)
    }
    assert marked == set(manual.generated())
    assert {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs" / "notebooks").glob("*.png")} == set(
        notebooks.images()
    )
