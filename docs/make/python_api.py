"""The reference page of ``import icymoon``: signatures and docstrings of the names that the package lists."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any

import icymoon

#: The names of the package in the order of the page.
ORDER = (
    "Scene",
    "RenderedPair",
    "RenderedEye",
    "open_pair",
    "open_pairs",
    "evaluate",
    "Evaluation",
    "Sweep",
    "SweepPoint",
    "Worker",
    "InProcess",
    "export_ground",
    "open_landed_day",
    "preset_names",
    "torch",
    "IcyMoonError",
)


def page() -> str:
    """The page as Markdown."""
    parts = [
        "# Python\n",
        "What `import icymoon` offers. This page is generated from the code. How to use it: "
        "[use Icy Moon from Python](../howto/python.md).\n",
    ]
    for name in ORDER:
        parts.append(_entry(name, getattr(icymoon, name)))
    return "\n".join(parts)


def _entry(name: str, item: Any) -> str:
    if inspect.ismodule(item):
        return f"## {name}\n\n{_prose(item)}\n\n" + _entry(f"{name}.Dataset", item.Dataset).replace("## ", "### ", 1)
    text = f"## {name}\n\n```text\n{name}{_signature(item)}\n```\n\n{_prose(item)}\n"
    if inspect.isclass(item):
        for key, member in vars(item).items():
            if not key.startswith("_") and (documented := _member(f"{name}.{key}", member)):
                text += f"\n{documented}"
    return text


def _member(name: str, member: object) -> str:
    """A method or property, if it has a docstring."""
    found = getattr(member, "fget", None) or getattr(member, "func", None) or member
    if not (inspect.isfunction(found) and found.__doc__):
        return ""
    shown = (
        _signature(found)
        if inspect.isfunction(member)
        else f" -> {_name_arrays(found.__annotations__.get('return', ''))}"
    )
    return f"### {name}\n\n```text\n{name.rpartition('.')[2]}{shown}\n```\n\n{_prose(found)}\n"


def _signature(item: Callable[..., Any]) -> str:
    """Parameters and result, with names of types as in the source."""
    try:
        text = str(inspect.signature(item))
    except ValueError:
        return ""
    text = re.sub(r"(: |-> )'([^']*)'", r"\1\2", text)
    text = re.sub(r"<function (\w+) at \w+>", r"\1", text)
    return _name_arrays(re.sub(r"\(self(, )?", "(", text).removesuffix(" -> None"))


def _name_arrays(text: str) -> str:
    """Types with NumPy's name of an array instead of ours."""
    return re.sub(r"\bArray\b", "np.ndarray", text)


def _prose(item: object) -> str:
    """The docstring as Markdown."""
    return inspect.cleandoc(item.__doc__ or "").replace("``", "`")
