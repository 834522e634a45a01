"""Labels in PDS3's Object Description Language: statements ``keyword = value`` in nested groups and objects.

Source: PDS Standards Reference 3.8, chapter 12. Values are texts in quotes, words, sequences in ``()`` and sets in
``{}``; they may continue on further lines. Units in ``<>`` and comments are left out. Content after the statement
``END``, such as an attached image, is ignored.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

#: A value: a word or the text of a quotation, or a sequence of values.
Value = str | list["Value"]
#: Deepest nesting of groups, and of sequences; the language has sequences of sequences at most.
_DEEPEST_NESTING = 32
#: Keywords that begin a group or object.
_GROUP_BEGINS = ("OBJECT", "GROUP", "BEGIN_OBJECT", "BEGIN_GROUP")
#: Keywords that end one.
_GROUP_ENDS = ("END_OBJECT", "END_GROUP")
_CLOSING_BRACKET = {"(": ")", "{": "}"}
#: Pattern of the next token, matched at the end of the last one; each alternative consumes every character once.
_TOKEN_PATTERN = re.compile(
    r"""(?P<space>\s++|/\*(?s:.*?)\*/|<[^<>]*>)|"(?P<text>[^"]*)"|'(?P<symbol>[^']*)'"""
    r"""|(?P<sign>[=(){},])|(?P<word>(?:(?!/\*)[^\s=(){},<>"'])+)"""
)


@dataclass
class Group:
    """A group or an object of a label: its ``name``, ``values`` by keyword, and the groups within it. If a keyword has
    two different values, the first is used and the keyword is in ``unclear``."""

    name: str
    values: dict[str, Value] = field(default_factory=dict)
    groups: list[Group] = field(default_factory=list)
    unclear: set[str] = field(default_factory=set)

    def list_all_groups(self) -> list[Group]:
        """List this group and all within it, in the order of the label."""
        return [self, *(inner for group in self.groups for inner in group.list_all_groups())]


def parse_label(text: str) -> Group:
    """Parse the content of a label as a group without a name. Raises ValueError, with the line, if it is not a
    label."""
    return _Parser(text).parse()


class _Parser:
    def __init__(self, text: str) -> None:
        self._text, self._at = text, 0
        self._token: tuple[str, str] | None = None
        self._start = 0  # where the last taken token begins

    def _fail(self, what: str) -> ValueError:
        return ValueError(f"line {self._text.count(chr(10), 0, self._start) + 1}: {what}")

    def _peek(self) -> tuple[str, str]:
        """Return the kind and the content of the next token; two empty texts at the end."""
        while self._token is None and self._at < len(self._text):
            self._start = self._at
            found = _TOKEN_PATTERN.match(self._text, self._at)
            if found is None or found.lastgroup is None:
                raise self._fail("a quotation, comment or unit without end, or a character that is out of place")
            self._at = found.end()
            if found.lastgroup != "space":
                self._token = found.lastgroup, found[found.lastgroup]
        return self._token or ("", "")

    def _take(self) -> tuple[str, str]:
        token = self._peek()
        self._token = None
        return token

    def parse(self) -> Group:
        whole = Group("")
        open_groups = [whole]
        while (token := self._take())[0]:
            keyword = token[1].upper()
            if self._peek() != ("sign", "="):
                if token == ("word", token[1]) and keyword == "END":
                    break
                if keyword in _GROUP_ENDS:
                    self._close(open_groups)
                continue  # a word of a text that should be in quotes
            self._take()
            value = self._parse_value(0)
            if keyword in _GROUP_BEGINS:
                if not isinstance(value, str):
                    raise self._fail("a group whose name is a sequence")
                if len(open_groups) > _DEEPEST_NESTING:
                    raise self._fail("groups are nested too deeply")
                open_groups.append(Group(value.upper()))
                open_groups[-2].groups.append(open_groups[-1])
            elif keyword in _GROUP_ENDS:
                self._close(open_groups)
            elif open_groups[-1].values.setdefault(keyword, value) != value:
                open_groups[-1].unclear.add(keyword)
        return whole

    def _close(self, open_groups: list[Group]) -> None:
        if len(open_groups) == 1:
            raise self._fail("the end of a group that has not begun")
        open_groups.pop()

    def _parse_value(self, depth: int) -> Value:
        kind, content = self._take()
        if kind != "sign":
            if not kind:
                raise self._fail("a statement without a value")
            return content
        if content not in _CLOSING_BRACKET or depth >= _DEEPEST_NESTING:
            raise self._fail(f"{content!r} is out of place")
        found: list[Value] = []
        while (token := self._peek())[1] != _CLOSING_BRACKET[content] or token[0] != "sign":
            if token == ("sign", ","):
                self._take()
            elif not token[0]:
                raise self._fail(f"{content!r} without its {_CLOSING_BRACKET[content]!r}")
            else:
                found.append(self._parse_value(depth + 1))
        self._take()
        return found
