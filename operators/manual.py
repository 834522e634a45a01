"""Open Manual: show the manual's pages in the web browser, from files of the extension, without a network.

The window makes the pages from Markdown, once in a session. So a checkout and an installed package have them too,
although neither has a step that builds pages.
"""

from __future__ import annotations

import html
import json
import posixpath
import re
from functools import lru_cache
from pathlib import Path

import bpy

from ..formats.markdown import list_anchors, render_page
from ..settings.table import TOPICS
from ..settings.topics.declaration import LANDFORMS
from ..support.errors import IcyMoonError
from ..support.files import explain_disk_errors, write_text
from ..support.temporary_folders import make_scratch_folder
from ..support.version import ROOT, version
from .sidebar_text import format_for_window

_DOCS_FOLDER = ROOT / "docs"
FIRST_PAGE = "index"
#: The page about the steps in the window.
WINDOW_PAGE = "tutorial/window"
_PAGE_BY_TOPIC = {
    "terrain": "theory/terrain",
    "hills": "theory/terrain#between-the-patch-and-the-horizon",
    "mesh": "theory/mesh",
    "source": "howto/own-ground",
    "surface": "theory/surfaces",
    "textures": "howto/own-textures",
    "rock_surface": "theory/surfaces",
    "excavation": "theory/excavation",
    "hapke": "theory/surfaces#hapkes-law",
    "rocks": "theory/terrain#what-lies-on-it",
    "light": "theory/light",
    "rig": "camera",
    "calibration_error": "howto/calibration-error",
    "left_eye": "howto/calibrations",
    "right_eye": "howto/calibrations",
    "lander": "howto/lander",
    "arm": "howto/lander",
    "workspace": "theory/decisions#the-workspace",
    "veil": "theory/light#a-veil-of-grains-or-vapour",
    "sensor": "theory/sensor",
    "quality": "howto/speed",
    "dataset": "datasets",
}
#: Titles of the pages' folders, in the order in which each page lists them at its top.
_GROUP_TITLES = {
    "": "Start",
    "tutorial": "Tutorials",
    "howto": "How to",
    "theory": "Theory",
    "reference": "Reference",
    "notebooks": "Notebooks",
}
_PAGE_STYLE = """body{font:16px/1.5 sans-serif;max-width:46em;margin:2em auto;padding:0 1em;color:#222;background:#fff}
nav{font-size:85%;border-bottom:1px solid #999;padding-bottom:.6em}nav a{margin-right:.9em;white-space:nowrap}
nav p{margin:.2em 0;padding-left:6em;text-indent:-6em}nav b{display:inline-block;width:6em;text-indent:0}
math[display=block]{margin:1em 0;overflow-x:auto}
a{color:#0b66b0}code,pre{background:#eee;font-size:90%}pre{padding:.6em;overflow:auto}
table{border-collapse:collapse}th,td{border:1px solid #999;padding:.2em .5em;text-align:left;vertical-align:top}
@media(prefers-color-scheme:dark){body{color:#ddd;background:#1d1f21}a{color:#7db8e8}code,pre{background:#2d2f33}}"""


@lru_cache(maxsize=1)
def list_page_names() -> tuple[str, ...]:
    """List the names of the manual's pages in this copy of Icy Moon, such as ``tutorial/window``, in reading order."""
    found = sorted(path.relative_to(_DOCS_FOLDER).with_suffix("").as_posix() for path in _DOCS_FOLDER.rglob("*.md"))
    return tuple(sorted(found, key=lambda name: name != FIRST_PAGE))


@lru_cache(maxsize=1)
def _read_formulas() -> dict[str, str]:
    """Read the MathML of each TeX formula, which ``docs/make/formulas.py`` has made."""
    found: dict[str, str] = json.loads((_DOCS_FOLDER / "formulas.json").read_text(encoding="utf-8"))
    return found


@lru_cache(maxsize=1)
def write_pages() -> Path:
    """Write all pages as HTML into a temporary folder, once in a session, and return the folder. Raises IcyMoonError if
    the pages are missing or cannot be written."""
    if not list_page_names():
        raise IcyMoonError(f"The manual is missing in {_DOCS_FOLDER}; install Icy Moon again.")
    folder = make_scratch_folder()
    texts = {name: (_DOCS_FOLDER / f"{name}.md").read_text(encoding="utf-8") for name in list_page_names()}
    titles = {name: _find_title(name, text) for name, text in texts.items()}
    for name, text in texts.items():
        target = folder / f"{name}.html"
        with explain_disk_errors("write to", folder):
            target.parent.mkdir(exist_ok=True)
            write_text(target, _make_html_page(name, text, titles))
    return folder


def _find_title(name: str, text: str) -> str:
    found = re.search(r"^# (.+)$", text, re.MULTILINE)
    return found[1].replace("`", "") if found else name


def _make_relative_address(name: str, page: str) -> str:
    """Return the address of the page ``name`` relative to the page ``page``."""
    return posixpath.relpath(f"{name}.html", posixpath.dirname(page) or ".")


def _make_html_page(page: str, text: str, titles: dict[str, str]) -> str:
    def address(link: str) -> str | None:
        if link.startswith("https://"):
            return link
        file, mark, anchor = link.partition("#")
        if not file:
            return link
        name = posixpath.normpath(posixpath.join(posixpath.dirname(page), file)).removesuffix(".md")
        return f"{_make_relative_address(name, page)}{mark}{anchor}" if name in titles else None

    def links(folder: str) -> str:
        return " ".join(
            f'<a href="{_make_relative_address(name, page)}">{html.escape(title)}</a>'
            for name, title in titles.items()
            if posixpath.dirname(name) == folder
        )

    groups = "".join(f"<p><b>{heading}</b> {links(folder)}</p>" for folder, heading in _GROUP_TITLES.items())
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(titles[page])} · Icy Moon '
        f"{version()}</title><style>{_PAGE_STYLE}</style></head><body><nav>{groups}</nav>\n"
        f"{render_page(text, address, _read_formulas().get)}\n</body></html>\n"
    )


def find_address(page: str) -> str:
    """Return the address of a page, such as ``tutorial/window``, or of a heading, such as
    ``howto/lidar#in-the-window``.

    Raises IcyMoonError if there is no such page or heading.
    """
    name, mark, anchor = page.partition("#")
    if name not in list_page_names():
        raise IcyMoonError(f"The manual has no page {name!r}; open the page {FIRST_PAGE!r}.")
    if mark and anchor not in list_anchors((_DOCS_FOLDER / f"{name}.md").read_text(encoding="utf-8")):
        raise IcyMoonError(f"The page {name!r} has no heading {anchor!r}; open the page without it.")
    return f"{write_pages().as_uri()}/{_make_file_name(page)}"


def _make_file_name(page: str) -> str:
    """Return the file name of a page, with the anchor of a heading if ``page`` names one."""
    name, mark, anchor = page.partition("#")
    return f"{name}.html{mark}{anchor}"


def find_page_of_topic(topic: str) -> str:
    """Return the page on a topic of the settings."""
    return _PAGE_BY_TOPIC["terrain" if TOPICS[topic].parent == LANDFORMS else topic]


def _make_manual_map() -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the targets of Online Manual in the context menu of our fields and buttons: the beginning of the
    addresses, and (pattern, end) of each target."""
    try:
        start = write_pages().as_uri()
    except IcyMoonError:
        return "", ()
    return f"{start}/", (
        *((f"bpy.types.icymoon_pg_{topic}.*", _make_file_name(find_page_of_topic(topic))) for topic in TOPICS),
        ("bpy.types.icymoon_*", f"{WINDOW_PAGE}.html"),
        ("bpy.ops.icymoon.*", f"{WINDOW_PAGE}.html"),
    )


class ICYMOON_OT_open_manual(bpy.types.Operator):
    """Open the manual in the web browser. It is part of the extension and needs no network"""

    bl_idname = "icymoon.open_manual"
    bl_label = "Open Manual"

    page: bpy.props.StringProperty(
        name="Page",
        default=FIRST_PAGE,
        options={"SKIP_SAVE"},
        description="Page of the manual, such as tutorial/window, or a heading: howto/lidar#in-the-window",
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return "Open the page of the manual on this panel" if properties.page != FIRST_PAGE else str(cls.__doc__)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            address = find_address(self.page)
        except IcyMoonError as error:
            self.report({"ERROR"}, format_for_window(error))
            return {"CANCELLED"}
        bpy.ops.wm.url_open(url=address)
        return {"FINISHED"}


CLASSES = (ICYMOON_OT_open_manual,)


def register() -> None:
    """Point Online Manual in the context menus to Icy Moon's manual."""
    bpy.utils.register_manual_map(_make_manual_map)


def unregister() -> None:
    """Point Online Manual in the context menus to Blender's manual again."""
    bpy.utils.unregister_manual_map(_make_manual_map)
