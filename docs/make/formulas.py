"""The formulas of the manual as MathML, for the pages in the window, which has no converter.

python docs/make/formulas.py        writes docs/formulas.json anew
"""

from __future__ import annotations

import json
from pathlib import Path

import latex2mathml.converter

DOCS = Path(__file__).resolve().parents[1]
FILE = DOCS / "formulas.json"


def mathml(tex: str, block: bool) -> str:
    """MathML of a formula in TeX."""
    return latex2mathml.converter.convert(tex, display="block" if block else "inline")


def of_manual() -> dict[str, str]:
    """The MathML of all formulas of the pages, by their TeX."""
    from icymoon.formats.markdown import find_formulas

    pages = sorted(DOCS.rglob("*.md"))
    return dict(
        sorted(
            {
                tex: mathml(tex, block)
                for page in pages
                for tex, block in find_formulas(page.read_text(encoding="utf-8"))
            }.items()
        )
    )


if __name__ == "__main__":
    FILE.write_text(json.dumps(of_manual(), indent=0, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"{len(of_manual())} formulas in {FILE.name}")
