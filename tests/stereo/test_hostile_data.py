"""Text from a data set stays text in reports and tables: it becomes no code of a page and no formula."""

from __future__ import annotations

import csv
import json
from html.parser import HTMLParser

import pairs
import pytest
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers.methods import parse_methods

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
        data |= {"versions": {"blender": EVIL}, "device": EVIL, "denoiser": EVIL}
        (pair / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    (folder / "set" / "pairs" / "broken" / "left.exr").write_bytes(b"none")  # which fails, with a message
    evaluate([folder / "set"], parse_methods("bm"), folder / "out")
    return folder / "out"


def test_a_page_has_no_element_and_no_script_that_a_data_set_brought(report):
    html = (report / "report.html").read_text(encoding="utf-8")
    assert "alert(1)" in html  # it is shown, as text
    found = Elements(html).found
    assert [attributes for tag, attributes in found if tag == "script"] == [
        {"type": "application/json", "id": "data"}, {}]
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
