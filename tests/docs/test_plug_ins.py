"""From nothing to a plug-in that is used, word by word from the manual; and the packages in ``docs/examples``."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from icymoon.commands.check_plugin import find_all_plugins
from icymoon.commands.cli import main
from icymoon.support.version import ROOT
from plugin_packages import add_package, examples

PAGE = (ROOT / "docs" / "howto" / "plug-ins.md").read_text(encoding="utf-8")
NAMES = ["census", "depth_p95", "few_paths", "npz", "waves"]


def test_every_example_is_on_the_page_and_tried_here(plugins_of_the_manual):
    assert sorted(plugins_of_the_manual) == sorted(NAMES)
    for project in examples():
        assert f"`docs/examples/{project.name}`" in PAGE
    found = {plugin.name: plugin.kind for each in find_all_plugins().values() for plugin in each.usable.values()}
    assert plugins_of_the_manual.items() <= found.items()


def test_the_metric_of_the_page_is_the_example():
    """But for its types."""
    source = (ROOT / "docs" / "examples" / "icymoon-quantile-metric" / "icymoon_quantile_metric.py").read_text("utf-8")
    source = source.replace("from __future__ import annotations\n\nfrom typing import Any\n\n", "")
    assert source.replace("(found: Any) -> float:", "(found):") in PAGE


#: The function by which a module of the page is known.
KINDS = {"match": "matcher", "height": "landform", "measure": "metric", "write_pair": "export"}
MODULES = [code for code in re.findall(r"(?ms)^```python\n(.*?)^```$", PAGE) if "ICYMOON_API" in code]


@pytest.mark.parametrize("code", MODULES, ids=lambda code: code.splitlines()[0])
def test_each_module_of_the_page_passes_its_check(code, tmp_path, monkeypatch, capsys):
    (kind,) = (kind for function, kind in KINDS.items() if f"def {function}(" in code)
    add_package(tmp_path, monkeypatch, kind, "of_the_page", code)
    assert main(["check-plugin", "of_the_page"]) == 0, capsys.readouterr().out


def test_the_page_shows_a_module_of_each_kind():
    assert len(MODULES) == len(KINDS)
    assert all(any(f"def {function}(" in code for code in MODULES) for function in KINDS)


@pytest.mark.parametrize("name", NAMES)
def test_each_passes_its_check(name, capsys):
    assert main(["check-plugin", name]) == 0, capsys.readouterr().out


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("project", examples(), ids=lambda project: project.name)
def test_pip_installs_each_from_its_folder(project, tmp_path):
    """With an entry point that a Python finds which looks for packages there."""
    copy = tmp_path / "source"
    copy.mkdir()
    for path in project.iterdir():  # the builder leaves a folder behind
        if path.is_file():
            (copy / path.name).write_bytes(path.read_bytes())
    site = tmp_path / "site"
    subprocess.run(
        [
            sys.executable,
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--no-deps",
            "--no-build-isolation",
            "--target",
            str(site),
            str(copy),
        ],
        check=True,
        timeout=100,
    )
    done = subprocess.run(
        [
            sys.executable,
            "-P",
            "-c",
            "import sys; sys.path.append(sys.argv[1]); "
            "from icymoon.__main__ import main; sys.exit(main(['check-plugin', sys.argv[2]]))",
            str(site),
            project.name,
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert done.returncode == 0, done.stdout + done.stderr
