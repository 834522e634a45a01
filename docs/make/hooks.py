"""MkDocs hooks of the manual: they turn formulas into MathML.

MathML needs no script and no font from elsewhere, so the manual can be read without a network.
"""

from __future__ import annotations

import html
import re

import formulas
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

#: The HTML that pymdownx.arithmatex makes of $…$ and $$…$$.
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn formulas into MathML."""
    return _FORMULA.sub(_mathml, content)


def _mathml(found: re.Match[str]) -> str:
    return formulas.mathml(html.unescape(found[3]), block=found[2] == "[")
