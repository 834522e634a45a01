"""Notebooks of the manual: run, stored with their outputs, and shown as pages.

    python docs/make/notebooks.py            # run all in docs/notebooks and keep their outputs
    python docs/make/notebooks.py first-pair # one of them

A notebook is run cell after cell in one Python, as Jupyter does: what a cell prints, then its last expression, then its
open figures of Matplotlib. Nothing of Jupyter is needed. Its working folder is temporary.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
#: Dots per inch of figures: small files, and sharp enough on a page.
_DPI = 80


def names() -> list[str]:
    """The notebooks, by name."""
    return sorted(path.stem for path in FOLDER.glob("*.ipynb"))


def read(name: str) -> dict[str, Any]:
    """A notebook as JSON."""
    found: dict[str, Any] = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    return found


def run(notebook: dict[str, Any]) -> None:
    """Run a notebook and store the outputs in it. Raises the exceptions of cells."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    scope: dict[str, Any] = {"__name__": "__main__"}
    count = 0
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for cell in notebook["cells"]:
                if cell["cell_type"] == "code":
                    count += 1
                    cell["execution_count"] = count
                    cell["outputs"] = _outputs("".join(cell["source"]), count, scope, pyplot, Path(folder).resolve())
        finally:
            os.chdir(before)


def _outputs(code: str, count: int, scope: dict[str, Any], pyplot: ModuleType, folder: Path) -> list[dict[str, Any]]:
    tree = ast.parse(code)
    last = tree.body[-1] if tree.body else None
    if isinstance(last, ast.Expr):
        tree.body.pop()
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, f"cell {count}", "exec"), scope)  # noqa: S102  our own pages
        value = (
            eval(compile(ast.Expression(last.value), f"cell {count}", "eval"), scope)
            if isinstance(last, ast.Expr)
            else None
        )
    found: list[dict[str, Any]] = []
    if text := printed.getvalue().replace(f"{folder}{os.sep}", ""):
        found.append({"output_type": "stream", "name": "stdout", "text": text.splitlines(keepends=True)})
    for number in pyplot.get_fignums():
        stream = io.BytesIO()
        pyplot.figure(number).savefig(stream, format="png", dpi=_DPI, bbox_inches="tight", metadata={"Software": None})
        found.append(
            {
                "output_type": "display_data",
                "metadata": {},
                "data": {"image/png": base64.b64encode(stream.getvalue()).decode(), "text/plain": ["a figure"]},
            }
        )
    if value is not None and not pyplot.get_fignums():
        shown = repr(value).replace(f"{folder}{os.sep}", "")
        found.append(
            {
                "output_type": "execute_result",
                "execution_count": count,
                "metadata": {},
                "data": {"text/plain": shown.splitlines(keepends=True)},
            }
        )
    pyplot.close("all")
    return found


def texts(notebook: dict[str, Any]) -> list[str]:
    """The printed texts and results of the cells, one text for each output that is not a figure."""
    return [
        "".join(output.get("text") or output["data"]["text/plain"])
        for cell in notebook["cells"]
        for output in cell.get("outputs", ())
        if "image/png" not in output.get("data", {})
    ]


def _figures(notebook: dict[str, Any]) -> list[str]:
    """The figures that cells show, as base64."""
    return [
        output["data"]["image/png"]
        for cell in notebook["cells"]
        for output in cell.get("outputs", ())
        if "image/png" in output.get("data", {})
    ]


def images() -> dict[str, bytes]:
    """The figures of the pages, by path below ``docs/``."""
    return {
        f"notebooks/{name}-{number}.png": base64.b64decode(image)
        for name in names()
        for number, image in enumerate(_figures(read(name)), start=1)
    }


def pages() -> dict[str, str]:
    """The notebooks as Markdown, by path below ``docs/``."""
    markdown: dict[str, str] = {}
    for name in names():
        parts: list[str] = []
        shown = 0
        for cell in read(name)["cells"]:
            source = "".join(cell["source"])
            if cell["cell_type"] == "markdown":
                parts.append(source)
                continue
            parts.append(f"```python\n{source}\n```")
            for output in cell["outputs"]:
                if "image/png" in output.get("data", {}):
                    shown += 1
                    parts.append(f"![What the cell shows]({name}-{shown}.png)")
                else:
                    text = "".join(output.get("text") or output["data"]["text/plain"]).rstrip()
                    parts.append(f"```text\n{text}\n```")
        parts.append(f"This page is a notebook, `docs/notebooks/{name}.ipynb`, with the outputs of a run.")
        markdown[f"notebooks/{name}.md"] = "\n\n".join(parts) + "\n"
    return markdown


def main(chosen: Sequence[str]) -> None:
    """Run notebooks and store their outputs."""
    for name in chosen or names():
        notebook = read(name)
        run(notebook)
        text = json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
        (FOLDER / f"{name}.ipynb").write_text(text, encoding="utf-8", newline="\n")
        print(name)


if __name__ == "__main__":
    main(sys.argv[1:])
