"""Converts the Markdown of the manual to HTML: only the syntax that its pages use; other text stays text.

The window shows the manual with it, without a network or another package. Pictures are replaced by their descriptions;
``make docs`` makes the whole manual.
"""

from __future__ import annotations

import html
import re
from collections.abc import Callable

#: Maps a link to its address; None removes the link.
Address = Callable[[str], "str | None"]
#: Maps a formula in TeX to HTML; None keeps the TeX.
Formula = Callable[[str], "str | None"]
_PICTURE_PATTERN = re.compile(r"\[?!\[([^\]]*)\]\([^)]*\)(?:\]\([^)]*\))?")
_LINK_PATTERN = re.compile(r"\[([^\]]+)\]\(([^)\s]+)\)")
#: Code, a displayed formula, a formula in the text.
_CODE_OR_FORMULA = re.compile(
    r"`(?P<code>[^`]+)`|\$\$(?P<block>.+?)\$\$|(?<![\w$])\$(?P<tex>[^$\s](?:[^$]*[^$\s])?)\$(?![\w$])", re.DOTALL
)
_LIST_ITEM = re.compile(r"(?:[*-]|\d+\.) +")
_TABLE_RULE = re.compile(r"\|?[\s:|-]+\|?")
#: The HTML in generated pages, after it was escaped: line breaks, anchors of links, and two signs.
_ESCAPED_HTML = re.compile(r'&lt;(br|span id="[\w.]+"|/span)&gt;|&amp;(nbsp|lt);')


def find_formulas(text: str) -> list[tuple[str, bool]]:
    """Find the formulas of a page in TeX, each with True if it is displayed in its own block."""
    outside = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.DOTALL | re.MULTILINE)
    return [
        (_clean_tex(found), bool(found["block"])) for found in _CODE_OR_FORMULA.finditer(outside) if not found["code"]
    ]


def _clean_tex(found: re.Match[str]) -> str:
    return " ".join((found["block"] or found["tex"]).split())


def make_anchor(heading: str) -> str:
    """Make the name of a heading in links, as MkDocs and GitHub do."""
    plain = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain)).strip("-")


def list_anchors(text: str) -> set[str]:
    """List the anchors of all headings of a page."""
    outside = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.DOTALL | re.MULTILINE)
    found = (re.match(r"#{1,6} +(.*)", line) for line in outside.splitlines())
    return {make_anchor(heading[1]) for heading in found if heading}


def render_page(text: str, address: Address, formula: Formula) -> str:
    """Convert a page to the HTML of its body."""

    def inline(text: str) -> str:
        return _render_inline(text, address, formula)

    text = re.sub(r"\A(?:---\n.*?\n---|<!--[^\n]*-->)\n", "", text, flags=re.DOTALL)
    text = _PICTURE_PATTERN.sub(lambda found: f"*Picture: {found[1]}*" if found[1] else "", text)
    lines, blocks, k = text.splitlines(), [], 0
    while k < len(lines):
        first = lines[k].strip()
        if not first:
            k += 1
            continue
        if first.startswith("```"):
            end = next((n for n in range(k + 1, len(lines)) if lines[n].strip() == "```"), len(lines))
            blocks.append(f"<pre><code>{html.escape(chr(10).join(lines[k + 1 : end]))}</code></pre>")
            k = end + 1
            continue
        end = next(
            (
                n
                for n in range(k + 1, len(lines))
                if not lines[n].strip() or lines[n].strip()[:3] == "```" or lines[k].startswith("#")
            ),
            len(lines),
        )
        if first != lines[k] and blocks and (item := re.fullmatch(r"(.*)(</li></[ou]l>)", blocks[-1], re.DOTALL)):
            more = inline(" ".join(line.strip() for line in lines[k:end]))
            blocks[-1] = f"{item[1]}<p>{more}</p>{item[2]}"
        else:
            blocks.append(_render_block(lines[k:end], inline))
        k = end
    return "\n".join(blocks)


def _render_block(lines: list[str], inline: Callable[[str], str]) -> str:
    """Convert one paragraph, heading, list, table or indented code to HTML."""
    first = lines[0].strip()
    if heading := re.match(r"(#{1,6}) +(.*)", first):
        level = len(heading[1])
        return f'<h{level} id="{make_anchor(heading[2])}">{inline(heading[2])}</h{level}>'
    if all(line.startswith("    ") for line in lines) and not _LIST_ITEM.match(first):
        return f"<pre><code>{html.escape(chr(10).join(line[4:] for line in lines))}</code></pre>"
    if first.startswith("|"):
        return _render_table(lines, inline)
    if _LIST_ITEM.match(first):
        items: list[str] = []
        for line in lines:
            if started := _LIST_ITEM.match(line.strip()):
                items.append(line.strip()[started.end() :])
            else:
                items[-1] += f" {line.strip()}"
        number = re.match(r"\d+", first)
        opening, kind = (f'<ol start="{number[0]}">', "ol") if number else ("<ul>", "ul")
        return opening + "".join(f"<li>{inline(item)}</li>" for item in items) + f"</{kind}>"
    return f"<p>{inline(' '.join(line.strip() for line in lines))}</p>"


def _render_table(lines: list[str], inline: Callable[[str], str]) -> str:
    rows = []
    for number, line in enumerate(lines):
        if _TABLE_RULE.fullmatch(line.strip()):
            continue
        cells = [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line.strip().strip("|"))]
        kind = "td" if number else "th"
        rows.append("<tr>" + "".join(f"<{kind}>{inline(cell)}</{kind}>" for cell in cells) + "</tr>")
    return f"<table>{''.join(rows)}</table>"


def _unescape(found: re.Match[str]) -> str:
    return f"<{found[1]}>" if found[1] else f"&{found[2]};"


def _render_inline(text: str, address: Address, formula: Formula) -> str:
    """Convert text with code, formulas, links and emphasis to HTML."""

    def linked(found: re.Match[str]) -> str:
        target = address(html.unescape(found[2]))
        return f'<a href="{html.escape(target, quote=True)}">{found[1]}</a>' if target else found[1]

    kept: list[str] = []  # code and formulas, in which nothing else is looked for

    def keep(found: re.Match[str]) -> str:
        kept.append(
            f"<code>{html.escape(found['code'])}</code>"
            if found["code"]
            else formula(_clean_tex(found)) or html.escape(found[0], quote=False)
        )
        return f"\0{len(kept) - 1}\0"

    text = _ESCAPED_HTML.sub(_unescape, html.escape(_CODE_OR_FORMULA.sub(keep, text), quote=False))
    text = _LINK_PATTERN.sub(linked, text)
    text = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", text)
    text = re.sub(r"(?<![\w*])\*([^\s*](?:[^*]*[^\s*])?)\*(?![\w*])", r"<i>\1</i>", text)
    return re.sub(r"\0(\d+)\0", lambda found: kept[int(found[1])], text)
