"""The manual is built whole, from the code that is here, twice the same, and needs nothing from elsewhere."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from icymoon.version import ROOT

pytest.importorskip("mkdocs", reason="`make docs` and `make test` install MkDocs")
pytest.importorskip("latex2mathml")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]  # building the pages counts for the first test


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built manual."""
    folder = tmp_path_factory.mktemp("manual")
    done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)], cwd=ROOT,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_formulas_that_the_window_shows_are_those_of_the_pages():
    """A formula that was changed needs ``python docs/make/formulas.py``."""
    sys.path.insert(0, str(ROOT / "docs" / "make"))
    import formulas

    assert json.loads(formulas.FILE.read_text(encoding="utf-8")) == formulas.of_manual()


def test_it_has_every_page_and_figure(site):
    sys.path.insert(0, str(ROOT / "docs" / "make"))
    import figures
    import reference

    pages = [path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")]
    pages += [Path(path).with_suffix(".html") for path in reference.pages()]
    assert [page for page in pages if not (site / page).is_file()] == []
    for name in figures.FIGURES:
        assert (site / "figures" / f"{name}.svg").read_bytes() == figures.svg(name), f"{name} differs when made again"
    assert not (site / "make").exists()


def test_it_loads_nothing_from_elsewhere(site):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r'(?:src|href)="(?:https?:)?//[^"]*"', text), page
        assert "\\(" not in text, f"{page}: a formula was left as it was written"


def test_it_holds_no_path_of_the_machine_that_made_it(site):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert str(ROOT) not in text
        assert sys.executable not in text
