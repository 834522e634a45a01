"""The manual is built whole, and needs nothing from elsewhere."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from icymoon.support.version import ROOT

pytest.importorskip("mkdocs", reason="`make docs` and `make test` install MkDocs")
pytest.importorskip("latex2mathml")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]  # building the pages counts for the first test


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built manual."""
    folder = tmp_path_factory.mktemp("manual")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_the_formulas_that_the_window_shows_are_those_of_the_pages():
    """A formula that was changed needs ``python docs/make/formulas.py``."""
    sys.path.insert(0, str(ROOT / "docs" / "make"))
    import formulas

    assert json.loads(formulas.FILE.read_text(encoding="utf-8")) == formulas.of_manual()


def test_it_has_every_page_and_figure(site):
    pages = [path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")]
    assert [page for page in pages if not (site / page).is_file()] == []
    figures = [path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.svg")]
    assert [figure for figure in figures if (site / figure).read_bytes() != (ROOT / "docs" / figure).read_bytes()] == []
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
