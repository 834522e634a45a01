"""Which matchers to run, from what a person writes: ``bm,sgbm:window=7`` and ``--option bm.window=21``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from ..errors import IcyMoonError
from .matchers import METHODS, check_options
from .matchers.options import nearest


@dataclass(frozen=True)
class Method:
    """A matcher with options, under the label it has in the report."""

    label: str
    name: str
    options: dict[str, str] = field(default_factory=dict)

    @property
    def file_name(self) -> str:
        """The label with nothing in it that a file system could mind."""
        return re.sub(r"[^A-Za-z0-9._-]+", "_", self.label)


def key_value(text: str, where: str) -> tuple[str, str]:
    """('a', 'b') of 'a=b'. Raises IcyMoonError, naming ``where``, for anything else."""
    key, equals, value = (part.strip() for part in text.partition("="))
    if not (key and equals and value):
        raise IcyMoonError(f"{where} {text}: write it as key=value, as in window=21.")
    return key, value


def parse_methods(text: str, options: Sequence[str] = ()) -> list[Method]:
    """The methods of a comma-separated list, checked before anything runs.

    A method may carry options of its own, ``bm:window=21:disparities=128``, so that one matcher can
    be compared with itself; ``options`` are ``method.key=value`` for every use of that method.
    Raises IcyMoonError for an unknown method or option, a bad value, or a method given twice.
    """
    shared: dict[str, dict[str, str]] = {}
    for option in options:
        name, value = key_value(option, "--option")
        method, dot, key = name.partition(".")
        if not dot:
            raise IcyMoonError(f"--option {option}: name the method too, as in bm.{key or name}={value}.")
        if method not in METHODS:
            raise IcyMoonError(f"--option {option}: unknown stereo method {method!r}, {nearest(method, METHODS)}")
        shared.setdefault(method, {})[key] = value
    methods: list[Method] = []
    for label in (part.strip() for part in text.split(",")):
        if not label:
            continue
        name, *own = label.split(":")
        chosen = shared.get(name, {}) | dict(key_value(part, "--methods") for part in own)
        check_options(name, chosen)
        if label in (method.label for method in methods):
            raise IcyMoonError(f"--methods names {label} twice; leave one out.")
        methods.append(Method(label, name, chosen))
    if not methods:
        raise IcyMoonError(f"--methods is empty; choose from {', '.join(METHODS)}.")
    unused = sorted(set(shared) - {method.name for method in methods})
    if unused:
        raise IcyMoonError(f"--option is given for {unused[0]}, which --methods does not name; add it or drop the "
                           "option.")
    return methods
