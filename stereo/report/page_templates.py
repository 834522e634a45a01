"""The templates of HTML pages."""

from __future__ import annotations

from pathlib import Path

import jinja2

from ...support.number_text import format_count
from ...support.printer import show_lines
from ..matchers.methods import describe_method

_TEMPLATE_FOLDER = Path(__file__).parent


def read_template(name: str, folder: Path = _TEMPLATE_FOLDER) -> jinja2.Template:
    """Read the template of a page from a folder; it may use the files beside the report's template.

    Foreign texts in the page are never markup, and have no invisible control characters. Each page can name a method
    for its readers (``name_of``) and a count (``count_of``).
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([folder, _TEMPLATE_FOLDER]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_escape_controls,
    )
    environment.globals |= {"count_of": format_count, "name_of": describe_method}
    return environment.get_template(name)


def _escape_controls(value: object) -> object:
    return show_lines(value) if type(value) is str else value
