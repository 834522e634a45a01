"""The commands of the manual name the plug-ins that it shows, as if they were installed."""

from __future__ import annotations

import pytest
from icymoon.version import ROOT
from plugin_packages import examples, install_project, write_from_page


@pytest.fixture(scope="session", autouse=True)
def plugins_of_the_manual(tmp_path_factory):
    """The example packages and those of the page, by name, with the kind of each."""
    site = tmp_path_factory.mktemp("site")
    page = (ROOT / "docs" / "howto" / "plug-ins.md").read_text(encoding="utf-8")
    kinds: dict[str, str] = {}
    for project in (*examples(), *write_from_page(page, tmp_path_factory.mktemp("projects"))):
        kinds |= install_project(project, site)
    patch = pytest.MonkeyPatch()
    patch.syspath_prepend(str(site))
    yield kinds
    patch.undo()
