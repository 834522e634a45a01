"""Open Manual leads from every panel to a page that exists, in files of the extension only."""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from pathlib import Path
from urllib.parse import unquote, urlsplit

import bpy
import pytest
from extension_zip import shipped
from icymoon.operators import manual
from icymoon.panels import CLASSES
from icymoon.settings.table import TOPICS

PANELS = [cls for cls in CLASSES if issubclass(cls, bpy.types.Panel)]


@pytest.fixture
def opened(monkeypatch):
    """The addresses that Blender is asked to open."""
    addresses: list[str] = []
    monkeypatch.setattr(
        manual,
        "bpy",
        type(
            "Stand",
            (),
            {
                "ops": type(
                    "Ops", (), {"wm": type("Wm", (), {"url_open": staticmethod(lambda url: addresses.append(url))})}
                )
            },
        ),
    )
    return addresses


@pytest.mark.parametrize("panel", PANELS, ids=lambda panel: panel.bl_idname)
def test_every_panel_has_a_page_that_is_in_the_zip(panel):
    name, mark, anchor = panel.page.partition("#")
    assert name in manual.list_page_names()
    assert f"docs/{name}.md" in shipped()
    page = (manual.write_pages() / f"{name}.html").read_text(encoding="utf-8")
    assert not mark or page.count(f' id="{anchor}"') == 1


def test_the_page_that_opens_is_a_file_of_ours_with_that_heading(opened):
    for page in (manual.FIRST_PAGE, "theory/terrain"):
        assert bpy.ops.icymoon.open_manual(page=page) == {"FINISHED"}
        address = urlsplit(opened[-1])
        assert address.scheme == "file"
        path = Path(unquote(address.path))
        assert path.is_relative_to(manual.write_pages())
        heading = re.search(r"^# (.+)$", (manual._DOCS_FOLDER / f"{page}.md").read_text(encoding="utf-8"), re.MULTILINE)
        assert f">{heading[1]}</h1>" in path.read_text(encoding="utf-8")


def test_a_page_opens_at_the_heading_that_is_asked_for(opened):
    assert bpy.ops.icymoon.open_manual(page="howto/lidar#in-the-window") == {"FINISHED"}
    assert urlsplit(opened[-1]).fragment == "in-the-window"
    with pytest.raises(RuntimeError, match="no heading 'gone'"):
        bpy.ops.icymoon.open_manual(page="howto/lidar#gone")
    assert len(opened) == 1


def test_links_to_headings_lead_to_headings():
    folder = manual.write_pages()
    pages = {path.resolve(): path.read_text(encoding="utf-8") for path in folder.rglob("*.html")}
    links = [
        ((path.parent / file).resolve() if file else path, anchor)
        for path, text in pages.items()
        for file, anchor in re.findall(r'href="([^"#:]*)#([^"]+)"', text)
    ]
    assert len(links) > 100
    assert [(path.name, anchor) for path, anchor in links if f' id="{anchor}"' not in pages[path]] == []


def test_no_other_file_can_be_opened(opened):
    with pytest.raises(RuntimeError, match="has no page"):
        bpy.ops.icymoon.open_manual(page="../../etc/passwd")
    assert opened == []


def test_links_between_pages_lead_to_pages():
    folder = manual.write_pages()
    links = [
        (path, link)
        for path in folder.rglob("*.html")
        for link in re.findall(r'href="([^"]*)"', path.read_text(encoding="utf-8"))
    ]
    assert len(links) > 100
    assert [
        (path.name, link)
        for path, link in links
        if not link.startswith("https://") and not (path.parent / link.partition("#")[0]).exists()
    ] == []


def test_online_manual_leads_to_the_page_of_each_setting():
    start, ends = manual._make_manual_map()
    for topic in TOPICS:
        field = f"bpy.types.icymoon_pg_{topic}.{TOPICS[topic].settings[0].key}"
        end = next(end for pattern, end in ends if fnmatchcase(field, pattern))
        assert f"{start}{end}" == manual.find_address(manual.find_page_of_topic(topic))
        assert Path(unquote(urlsplit(start + end).path)).is_file()
    assert manual._make_manual_map in bpy.utils._manual_map


def test_every_formula_of_the_manual_is_mathml():
    assert "docs/formulas.json" in shipped()
    assert not [
        path.name
        for path in manual.write_pages().rglob("*.html")
        if re.search(
            r"\\(frac|theta|mathrm|hat)", re.sub(r"<(code|pre)>.*?</\1>", "", path.read_text("utf-8"), flags=re.DOTALL)
        )
    ]


def test_every_page_is_linked_from_every_page():
    page = (manual.write_pages() / "theory" / "terrain.html").read_text(encoding="utf-8")
    assert page[: page.index("</nav>")].count("<a ") == len(manual.list_page_names())
