"""The subset of YAML in which calibrations are written: read without building any object, and numbers written.

Supported are mappings and sequences by indentation, lists and mappings in brackets over any number of lines, quoted and
plain scalars, and comments. The tags of OpenCV's matrices are skipped, because the values after them state the same.
Other tags, anchors, aliases and texts over several lines are refused. Time and memory grow with the length of the text.
"""

from __future__ import annotations

import re
from typing import Any

from ..support.files import quote

_NUMBER_PATTERN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
_NAN_OR_INFINITY = re.compile(r"([-+]?)\.(nan|inf)", re.IGNORECASE)
_KEY_PATTERN = re.compile(r"""("[^"]*"|'[^']*'|[^\s"'\[\]{}#,:&*!|>%@`-][^:]*|-[^\s:][^:]*):(?:\s+|$)""")
_QUOTED_SCALAR = re.compile(r""""(?:[^"\\]|\\.)*"|'(?:[^']|'')*'""")
_QUOTE_MARK = re.compile("[\"']")
_PLAIN_SCALAR = re.compile(r"[^,\[\]{}:\s](?:[^,\[\]{}:]|:(?=\S))*")
_BLANKS = re.compile(r"\s*")
#: Tags of OpenCV, which are skipped.
_SKIPPED_TAGS = ("!!opencv-matrix", "!!opencv-nd-matrix")
_REFUSED_MARKS = {
    "!": "a tag",
    "&": "an anchor",
    "*": "an alias",
    "|": "a text over several lines",
    ">": "a text over several lines",
}
#: Deepest nesting.
_DEEPEST_NESTING = 20
#: Longest number in characters.
_LONGEST_NUMBER = 60
_CUT_OFF = "a bracket is not closed; the file is cut off"


def parse_yaml(text: str) -> dict[str, Any]:
    """Parse a text into its mapping: keys are texts, values are int, float, str, None, lists and mappings.

    Raises ValueError with the line for anything else, and for a key that is stated twice.
    """
    found = _Block(text).parse()
    if not isinstance(found, dict):
        raise ValueError("it is not a mapping of keys to values")
    return found


def parse_flow(text: str) -> Any:
    """Parse a text in brackets, as JSON, YAML and Python write it. Raises ValueError for another text."""
    flow = _Flow(text)
    found = flow.value(0)
    if flow.skip() != len(text):
        raise ValueError(f"{quote(text[flow.at : flow.at + 40])} follows the end")
    return found


def write_number(value: float) -> str:
    """Write a number with all of its digits. YAML 1.1, which PyYAML reads, parses 2e-05 as a text and 2.0e-05 as a
    number."""
    mantissa, exponent_sign, exponent = repr(float(value)).partition("e")
    return mantissa + (".0" if exponent_sign and "." not in mantissa else "") + exponent_sign + exponent


def _scalar(text: str) -> Any:
    """Convert a plain or quoted scalar to a number, a text, or None."""
    if text[:1] in ("'", '"'):
        if not _QUOTED_SCALAR.fullmatch(text):
            raise ValueError(f"{quote(text)} has no closing quote")
        return text[1:-1]
    if text[:1] in _REFUSED_MARKS:
        raise ValueError(f"{_REFUSED_MARKS[text[0]]}, {quote(text)}, is not read; write the value itself")
    if len(text) <= _LONGEST_NUMBER and _NUMBER_PATTERN.fullmatch(text):
        return float(text) if any(sign in text for sign in ".eE") else int(text)
    if special := _NAN_OR_INFINITY.fullmatch(text):
        return float(special[1] + special[2])
    return None if text in ("", "~", "null") else text


class _Flow:
    """A cursor over a value in brackets."""

    def __init__(self, text: str) -> None:
        self.text, self.at = text, 0

    def skip(self) -> int:
        """Go to the next character that is not a blank, and return its index."""
        self.at = _BLANKS.match(self.text, self.at).end()  # type: ignore[union-attr]
        return self.at

    def _next(self) -> str:
        self.skip()
        return self.text[self.at : self.at + 1]

    def _take(self, sign: str) -> bool:
        """Skip the sign if it comes next; returns whether it did."""
        there = self._next() == sign
        self.at += there
        return there

    def value(self, depth: int) -> Any:
        """Parse the next value."""
        if depth > _DEEPEST_NESTING:
            raise ValueError("it is nested too deeply")
        if self._take("["):
            return self._list(depth)
        if self._take("{"):
            return self._mapping(depth)
        match = _QUOTED_SCALAR.match(self.text, self.at) or _PLAIN_SCALAR.match(self.text, self.at)
        if match is None and self.at == len(self.text):
            raise ValueError(_CUT_OFF)
        if match is None:
            raise ValueError(f"a value is missing before {quote(self.text[self.at : self.at + 20])}")
        self.at = match.end()
        return _scalar(match[0].rstrip())

    def _list(self, depth: int) -> list[Any]:
        found = []
        while not self._take("]"):
            found.append(self.value(depth + 1))
            if not self._take(",") and (sign := self._next()) != "]":
                raise ValueError("a list has no comma between two values" if sign else _CUT_OFF)
        return found

    def _mapping(self, depth: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        while not self._take("}"):
            key = self.value(depth + 1)
            if not self._next():
                raise ValueError(_CUT_OFF)
            if not isinstance(key, str | int | float) or not self._take(":"):
                raise ValueError("a mapping has a key without a value")
            if str(key) in found:
                raise ValueError(f"it states {quote(str(key))} twice")
            found[str(key)] = self.value(depth + 1)
            if not self._take(",") and (sign := self._next()) != "}":
                raise ValueError("a mapping has no comma between two values" if sign else _CUT_OFF)
        return found


class _Block:
    """The lines of a text: number, indentation and content of each line that is not blank."""

    def __init__(self, text: str) -> None:
        self.lines: list[tuple[int, int, str]] = []
        for number, line in enumerate(text.split("\n"), 1):
            content = _strip_comment(line).rstrip()
            inner = content.lstrip(" ")
            if inner.startswith("\t"):
                raise ValueError(f"line {number} is indented by a tab; use blanks")
            if inner and not content.startswith(("%", "---", "...")):
                self.lines.append((number, len(content) - len(inner), inner))
        self.at = 0

    def parse(self) -> Any:
        """Parse the value of the whole text."""
        if not self.lines:
            raise ValueError("it is empty")
        if self.lines[0][2].startswith(("{", "[")):
            return parse_flow("\n".join(content for _, _, content in self.lines))
        found = self._block(self.lines[0][1], 0)
        if self.at < len(self.lines):
            raise ValueError(f"line {self.lines[self.at][0]} is indented as no other; correct it")
        return found

    def _block(self, indent: int, depth: int) -> Any:
        if depth > _DEEPEST_NESTING:
            raise ValueError("it is nested too deeply")
        return self._sequence(indent, depth) if _is_item(self.lines[self.at][2]) else self._mapping(indent, depth)

    def _more(self, indent: int) -> bool:
        return self.at < len(self.lines) and self.lines[self.at][1] == indent

    def _sequence(self, indent: int, depth: int) -> list[Any]:
        found = []
        while self._more(indent) and _is_item(self.lines[self.at][2]):
            number, _, content = self.lines[self.at]
            rest = content[1:].lstrip(" ")
            if rest and (_is_item(rest) or _KEY_PATTERN.match(rest)):  # a block begins in the line of its dash
                inner = indent + len(content) - len(rest)
                self.lines[self.at] = number, inner, rest
                found.append(self._block(inner, depth + 1))
            else:
                self.at += 1
                found.append(self._value(number, rest, indent, depth))
        return found

    def _mapping(self, indent: int, depth: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        while self._more(indent):
            number, _, content = self.lines[self.at]
            match = _KEY_PATTERN.match(content)
            if match is None:
                raise ValueError(f"line {number}: {quote(content)} is not a key with a value")
            key = match[1].strip().strip("\"'")
            if key in found:
                raise ValueError(f"line {number} states {quote(key)} again")
            self.at += 1
            found[key] = self._value(number, content[match.end() :].strip(), indent, depth, in_mapping=True)
        return found

    def _value(self, number: int, text: str, indent: int, depth: int, in_mapping: bool = False) -> Any:
        """Parse the value that begins with ``text`` in the line ``number``, or in the lines nested below it."""
        for tag in _SKIPPED_TAGS:
            if text.split(" ", 1)[0] == tag:
                text = text.removeprefix(tag).strip()
        if not text:
            if self.at == len(self.lines):
                return None
            _, inner, content = self.lines[self.at]
            # A sequence may have the same indentation as its key.
            if inner > indent or (in_mapping and inner == indent and _is_item(content)):
                return self._block(inner, depth + 1)
            return None
        try:
            return parse_flow(self._brackets(number, text)) if text[0] in "[{" else _scalar(text)
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from None

    def _brackets(self, number: int, text: str) -> str:
        """Parse a value in brackets, joined from all its lines."""
        parts, is_open = [text], _opened(text)
        while is_open > 0:
            if self.at == len(self.lines):
                raise ValueError(_CUT_OFF)
            parts.append(self.lines[self.at][2])
            is_open += _opened(parts[-1])
            self.at += 1
        return "\n".join(parts)


def _is_item(content: str) -> bool:
    return content == "-" or content.startswith("- ")


def _opened(text: str) -> int:
    """Return how many more brackets a text opens than it closes."""
    plain = _mask_quotes(text)
    return plain.count("[") + plain.count("{") - plain.count("]") - plain.count("}")


def _strip_comment(line: str) -> str:
    """Remove the comment at the end of a line. A comment begins with a # at the beginning or after a blank, outside
    quotes."""
    if "#" not in line:
        return line
    masked = _mask_quotes(line)
    at = 0 if masked.startswith("#") else masked.find(" #")
    return line if at < 0 else line[:at]


def _mask_quotes(text: str) -> str:
    """Replace each character in quotes by an x."""
    parts, at = [], 0
    while quote_mark := _QUOTE_MARK.search(text, at):
        start = quote_mark.start()
        match = _QUOTED_SCALAR.match(text, start)
        if match is None:  # an apostrophe; the search ends here, so that no text is searched twice
            break
        parts += [text[at:start], "x" * len(match[0])]
        at = match.end()
    return "".join([*parts, text[at:]])
