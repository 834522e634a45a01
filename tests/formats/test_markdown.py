"""The manual's Markdown as HTML, against Python-Markdown, which the whole manual is made with."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import pytest
from icymoon.formats.markdown import find_formulas, render_page
from icymoon.support.version import ROOT

PAGES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))
_KINDS = ("h1", "h2", "h3", "h4", "pre", "td", "th", "li", "code", "a")


class Parts(HTMLParser):
    """The texts of the elements of each kind, without spaces, and the addresses of the links."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: dict[str, list[str]] = {kind: [] for kind in _KINDS}
        self.links: list[str] = []
        self._open: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        if tag in _KINDS:
            self._open.append(tag)
            self.found[tag].append("")
        if tag == "a":
            self.links.append(dict(attributes)["href"] or "")

    def handle_endtag(self, tag: str) -> None:
        if tag in _KINDS:
            self._open.remove(tag)

    def handle_data(self, data: str) -> None:
        for tag in self._open:
            self.found[tag][-1] += re.sub(r"\s", "", data)


@pytest.mark.parametrize("page", PAGES)
def test_a_page_has_the_parts_that_python_markdown_finds(page):
    markdown = pytest.importorskip("markdown", reason="`make docs` and `make test` install Python-Markdown")
    text = (ROOT / page).read_text(encoding="utf-8")
    text = re.sub(r"\A---\n.*?\n---\n", "", text, flags=re.DOTALL)
    without = re.sub(r"\[?!\[([^\]]*)\]\([^)]*\)(\]\([^)]*\))?", r"*Picture: \1*", text)
    expected = Parts(markdown.markdown(without, extensions=["tables", "fenced_code"]))
    ours = Parts(render_page(text, lambda link: link, lambda tex: None))
    assert ours.links == expected.links
    for kind in _KINDS:
        assert ours.found[kind] == expected.found[kind], kind


def test_what_is_no_markdown_stays_text_and_runs_nothing():
    page = render_page(
        "<script>alert(1)</script> a < b & *c* `<i>`\n\n[x](javascript:alert(1))", lambda link: None, lambda tex: None
    )
    assert "<script" not in page
    assert "href" not in page
    assert "a &lt; b &amp; <i>c</i> <code>&lt;i&gt;</code>" in page


def test_of_html_only_breaks_places_and_two_signs_are_kept():
    page = render_page(
        '<!-- x -->\n\n<span id="a.b"></span>c<br>1&nbsp;m &lt;d> <span id="x" onclick="y"> <br x> &copy;',
        lambda link: None,
        lambda tex: None,
    )
    assert page == (
        '<p><span id="a.b"></span>c<br>1&nbsp;m &lt;d&gt; &lt;span id="x" onclick="y"&gt; &lt;br x&gt; &amp;copy;</p>'
    )


def test_formulas_are_found_outside_of_code_and_replaced():
    text = "The $a_1 *b* c$ of `$x$`, 5 $ and 6 $, or\n\n```\necho $HOME $USER\n```\n\n$$y\n= 2$$\n"
    assert find_formulas(text) == [("a_1 *b* c", False), ("y = 2", True)]
    page = render_page(text, lambda link: None, {"a_1 *b* c": "<math>1</math>", "y = 2": "<math>2</math>"}.get)
    assert page == (
        "<p>The <math>1</math> of <code>$x$</code>, 5 $ and 6 $, or</p>\n"
        "<pre><code>echo $HOME $USER</code></pre>\n<p><math>2</math></p>"
    )


def test_a_formula_without_mathml_stays_as_it_is_written():
    assert render_page("$a < b$", lambda link: None, lambda tex: None) == "<p>$a &lt; b$</p>"
