"""The files of the manual that are made from the code. They are stored in ``docs/``, so that its links work in a clone.

python docs/make/generated.py       writes all of them anew, as `make docs-pages` does
"""

from __future__ import annotations

import figures
import notebooks
import reference
from icymoon.support.version import ROOT

DOCS = ROOT / "docs"


def files() -> dict[str, bytes]:
    """Every generated file, by its path below ``docs/``."""
    return (
        {path: text.encode() for path, text in reference.pages().items()}
        | notebooks.images()
        | {f"figures/{name}.svg": figures.svg(name) for name in figures.FIGURES}
    )


def main() -> None:
    """Write the files and list those that have changed."""
    for path, content in files().items():
        target = DOCS / path
        if not target.is_file() or target.read_bytes() != content:
            target.parent.mkdir(exist_ok=True)
            target.write_bytes(content)
            print(target.relative_to(ROOT).as_posix())


if __name__ == "__main__":
    main()
