"""Packages with plug-ins, as pip leaves them, in a folder that Python looks for packages in."""

from __future__ import annotations

import itertools
import re
import shutil
import tomllib
from pathlib import Path
from textwrap import dedent

import pytest
from icymoon.support.version import ROOT

_numbers = itertools.count()


def add_package(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    name: str,
    source: str,
    *,
    package: str = "",
    version: str = "1.0",
    licence: str = "MIT",
    group: str = "",
) -> str:
    """Install a package with one plug-in in ``folder``; its name. The module has a name that no other test uses."""
    package = package or f"icymoon-test-{name.replace('_', '-')}"
    module = f"plugin_of_a_test_{next(_numbers)}"
    info = folder / f"{package.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n" + (f"License: {licence}\n" if licence else ""),
        encoding="utf-8",
    )
    (info / "entry_points.txt").write_text(f"[{group or f'icymoon.{kind}s'}]\n{name} = {module}\n", encoding="utf-8")
    (folder / f"{module}.py").write_text(dedent(source), encoding="utf-8")
    monkeypatch.syspath_prepend(str(folder))
    return package


#: A matcher that knows the plane of ``check-plugin`` without looking.
MATCHER = '''\
"""Twelve everywhere."""
import numpy as np
ICYMOON_API = 1

def match(left, right, context):
    return np.full(left.shape, 12.0, np.float32)
'''

#: A landform that is a step at x = 0.
LANDFORM = '''\
"""Steps of ice."""
import numpy as np
ICYMOON_API = 1
SETTINGS = {"height_m": {"default": 0.0, "minimum": 0.0, "maximum": 5.0, "label": "Height", "doc": "Height"},
            "count": {"default": 3, "minimum": 1, "maximum": 9, "label": "Count", "doc": "Number of steps"}}

def height(x, y, settings):
    return np.where(x > 0, settings['height_m'], 0.0)

def finest_m(settings):
    return 0.5
'''


def install_project(project: Path, site: Path) -> dict[str, str]:
    """What pip makes of a folder with a ``pyproject.toml`` and modules, in ``site``: the kinds of its plug-ins by name.

    Most tests take this, as pip needs seconds; one test takes pip.
    """
    facts = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    info = site / f"{facts['name'].replace('-', '_')}-{facts['version']}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.4\nName: {facts['name']}\nVersion: {facts['version']}\n"
        f"License-Expression: {facts['license']}\n",
        encoding="utf-8",
    )
    (info / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n" + "".join(f"{name} = {module}\n" for name, module in entries.items())
            for group, entries in facts["entry-points"].items()
        ),
        encoding="utf-8",
    )
    for module in project.glob("*.py"):
        shutil.copy(module, site)
    return {
        name: group.removeprefix("icymoon.").removesuffix("s")
        for group, entries in facts["entry-points"].items()
        for name in entries
    }


def examples() -> list[Path]:
    """The folders of the plug-ins that the manual shows; other examples add nothing to Icy Moon."""
    projects = (ROOT / "docs" / "examples").glob("*/pyproject.toml")
    return sorted(path.parent for path in projects if "entry-points" in path.read_text(encoding="utf-8"))


def write_from_page(page: str, folder: Path) -> list[Path]:
    """The packages that stand on a page, each in a folder: of every ``pyproject.toml`` and the Python after it."""
    fences = re.findall(r"(?m)^```(toml|python)\n(.*?)^```$", page, re.DOTALL)
    found = []
    for (kind, text), (next_kind, source) in itertools.pairwise(fences):
        if kind == "toml" and "[project]" in text and next_kind == "python":
            facts = tomllib.loads(text)
            project = folder / facts["project"]["name"]
            project.mkdir(parents=True)
            (project / "pyproject.toml").write_text(text, encoding="utf-8")
            (project / f"{facts['tool']['setuptools']['py-modules'][0]}.py").write_text(source, encoding="utf-8")
            found.append(project)
    return found
