"""Text from a data set stays text in reports and tables: it becomes no code of a page and no formula."""

from __future__ import annotations

import csv
import json
import re
import shlex
import sys
from html.parser import HTMLParser

import foreign
import numpy as np
import pairs
import plugin_packages
import pytest
from icymoon.stereo import cli
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.report.charts import make_figure, render_svg
from icymoon.stereo.report.page_templates import read_template
from icymoon.support.version import ROOT

#: Text that closes an attribute, an element, a script, a comment; and a formula that no drawing can set.
EVIL = """'"></pre></script>--><script>alert(1)</script><img src=x onerror=alert(1)> $\\frac{$ {{ 7 * 7 }}"""


class Elements(HTMLParser):
    """The elements and attributes of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """What is made of pairs whose every text is hostile."""
    folder = tmp_path_factory.mktemp("hostile")
    for k, name in enumerate(["=HYPERLINK(1)", "@SUM(1)", "-1+1", "broken"]):
        pair = pairs.write_pair(folder / "set" / "pairs" / name, rig=pairs.camera(96, 48))
        data = json.loads((pair / "pair.json").read_text(encoding="utf-8"))
        data["settings"]["light"] |= {"body": EVIL if k else "EUROPA", "sun_elevation_deg": 10.0 * k}
        data["settings"]["dataset"]["folder"] = EVIL
        data |= {"versions": {"blender": EVIL}, "platform": EVIL}
        (pair / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    (folder / "set" / "pairs" / "broken" / "left.exr").write_bytes(b"none")  # which fails, with a message
    evaluate([folder / "set"], parse_methods("bm"), folder / "out")
    return folder / "out"


def test_a_page_has_no_element_and_no_script_that_a_data_set_brought(report):
    html = (report / "report.html").read_text(encoding="utf-8")
    assert "alert(1)" in html  # it is shown, as text
    found = Elements(html).found
    assert [attributes for tag, attributes in found if tag == "script"] == [
        {"type": "application/json", "id": "data"},
        {},
    ]
    assert not [name for _, attributes in found for name in attributes if name.startswith("on")]
    # An image without a source is filled from another image of the page.
    assert all(str(attributes.get("src", "data:")).startswith("data:") for tag, attributes in found if tag == "img")
    assert "{{ 7 * 7 }}" in html
    assert not {tag for tag, _ in found} & {"iframe", "object", "embed", "form", "link", "base"}


def test_a_table_has_no_formula_that_a_data_set_brought(report):
    with (report / "results.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert sorted(row["pair"] for row in rows) == ["'-1+1", "'=HYPERLINK(1)", "'@SUM(1)", "broken"]
    assert all(not value.startswith(("=", "@", "+")) for row in rows for value in row.values())


#: Parts of a path, which has no slash of its own: together with the slash between them they end an element.
MARKUP = ("a\"'><img src=x onerror=alert(1)><", "script><script>alert(1)<", "b><a href='javascript:alert(1)'>&lt;")
#: A text that ends what it is in.
TEXT = "/".join(MARKUP)
METRIC = """
__doc__ = {doc!r}
ICYMOON_API = 1
UNIT, DECIMALS, BETTER = "px", 1, "lower"
def measure(disparity, truth, context):
    return 1.0
"""


def evaluate_names(folder, monkeypatch, markup, text):
    """The page of pairs, rendered and foreign, of a damaged one, of predictions, a program and a plug-in, whose every
    name is of these words."""
    root = folder.joinpath(*markup)
    for name in ("whole&lt;b&gt;'", "broken'"):
        pair = pairs.write_pair(root / "set" / "pairs" / name, rig=pairs.camera(96, 48))
        data = json.loads((pair / "pair.json").read_text(encoding="utf-8"))
        data["settings"]["light"]["body"] = text
        data["settings"]["dataset"]["folder"] = text
        data |= {"versions": {"blender": text}, "device": text, "denoiser": text}
        (pair / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    (root / "set" / "pairs" / "broken'" / "left.exr").write_bytes(b"none")
    strange = foreign.plain(
        root / "foreign",
        'disparity = "truth/{pair}.npy"',
        "",
        np.random.default_rng(1).uniform(0, 40, foreign.constant().shape),
    )
    (root / "net").mkdir()
    np.save(root / "net" / "a.npy", foreign.constant())
    plugin_packages.add_package(folder / "site", monkeypatch, "metric", "evil", METRIC.format(doc=text))
    program = root / "evil.py"
    program.write_text(f"import sys; sys.exit({text!r})", encoding="utf-8")
    command = f"{shlex.quote(sys.executable)} {shlex.quote(str(program))} {{left}} {{right}} {{out}}"
    cli.main(
        [
            "evaluate",
            str(root / "set"),
            str(strange),
            "--methods",
            "bm",
            "--method",
            f"evil=external:command={command}",
            "--predictions",
            f"net={root / 'net'}",
            "--out",
            str(folder / "out"),
            "--jobs",
            "1",
        ]
    )
    return Elements((folder / "out" / "report.html").read_text(encoding="utf-8")).found


@pytest.mark.long
@pytest.mark.heavy
def test_no_name_from_anywhere_adds_to_a_page(tmp_path, monkeypatch, capsys):
    found = evaluate_names(tmp_path / "1", monkeypatch, MARKUP, TEXT)
    usual = evaluate_names(tmp_path / "2", monkeypatch, ("a", "b", "c"), "plain")
    page = (tmp_path / "1" / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("onerror=alert(1)") > 8  # all are there, as texts
    assert {(tag, *sorted(attributes)) for tag, attributes in found} == {
        (tag, *sorted(attributes)) for tag, attributes in usual
    }
    assert [tag for tag, _ in found].count("script") == [tag for tag, _ in usual].count("script") == 2
    for _, attributes in found:
        for name in ("href", "src", "action", "xlink:href"):
            assert str(attributes.get(name, "#")).startswith(("data:", "#"))
    data = json.loads(page.split('id="data">')[1].split("</script>")[0])
    assert {row[0] for row in data["pairs"]} >= {"whole&lt;b&gt;'", "broken'", "a"}
    capsys.readouterr()


def test_every_page_escapes_what_it_is_given():
    """What a template does not escape are the pictures and scripts that this program makes."""
    for template in ROOT.glob("stereo/*/*.j2"):
        text = template.read_text(encoding="utf-8")
        assert set(re.findall(r"{{ *(\w+) *\| *safe", text)) <= {"svg", "roc", "chart", "data", "script"}
        assert "autoescape" not in text
    page = read_template("report.html.j2").environment.from_string("<p title='{{ a }}'>{{ a }}</p>").render(a=TEXT)
    assert [(tag, list(attributes)) for tag, attributes in Elements(page).found] == [("p", ["title"])]


def test_a_chart_has_no_element_that_a_name_brought():
    figure, rows = make_figure(1)
    axes = rows[0, 0]
    axes.plot([0, 1], label=TEXT)
    axes.set_title(TEXT)
    axes.set_xticks([0], labels=[TEXT])
    axes.legend()
    found = {tag for tag, _ in Elements(render_svg(figure, "a", "b")).found}
    assert not found & {"script", "img", "a", "b"}
