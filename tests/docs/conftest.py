"""The commands of the manual name the plug-ins that it shows, as if they were installed."""

from __future__ import annotations

import pytest
from icymoon.support.version import ROOT
from plugin_packages import examples, install_project, write_from_page


@pytest.fixture(scope="session")
def installed_plugins(tmp_path_factory):
    """The folder with the example packages and those of the page, and the kind of each by its name."""
    site = tmp_path_factory.mktemp("site")
    page = (ROOT / "docs" / "howto" / "plug-ins.md").read_text(encoding="utf-8")
    kinds: dict[str, str] = {}
    for project in (*examples(), *write_from_page(page, tmp_path_factory.mktemp("projects"))):
        kinds |= install_project(project, site)
    return site, kinds


@pytest.fixture(scope="module", autouse=True)
def plugins_of_the_manual(installed_plugins):
    """The kind of each plug-in by its name, while they are on the path: no longer, since tests elsewhere list all."""
    site, kinds = installed_plugins
    patch = pytest.MonkeyPatch()
    patch.syspath_prepend(str(site))
    yield kinds
    patch.undo()
