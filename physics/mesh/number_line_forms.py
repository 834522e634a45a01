"""The forms of the lines of a text of many numbers. A form is a line with each run of digits replaced by one 0.

Whether the words of a line are numbers does not depend on which digits they have, nor on how many. A large mesh has few
forms of lines, so the forms are checked instead of millions of lines. A text that is unusual in any way is left to the
check line by line, which finds the line at fault.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ...support.arrays import Array
from ...support.foreign_bytes import LONGEST_LINE, ForeignBytes

#: Bytes that are looked at together, which stay in the processor's cache; most forms that are kept, and
#: the longest.
_TOGETHER, _MOST_FORMS, _LONGEST_FORM = 2**16, 10_000, 200
_WINDOW = LONGEST_LINE // 2
_MANY_DIGITS = b"0" * 300
_DIGITS = bytes.maketrans(b"123456789", b"0" * 9)


class UnusualTextError(Exception):
    """A text must be looked at line by line."""


def read_whole_lines(foreign: ForeignBytes, start: int = 0) -> Iterator[bytes]:
    """A text from byte ``start`` on, in parts that end with a line.

    Raises UnusualError where lines may be longer than ``LONGEST_LINE``, or do not end in \\n.
    """
    rest = b""
    for at in range(start, foreign.size, _TOGETHER):
        data = rest + foreign.part(at, min(_TOGETHER, foreign.size - at))
        # A line that is too long fills one of these windows.
        if any(data.find(b"\n", k, k + _WINDOW) < 0 for k in range(0, len(data) - _WINDOW, _WINDOW)):
            raise UnusualTextError
        end = data.rfind(b"\n") + 1
        if end:
            yield data[:end]
        rest = data[end:]
    if rest:
        yield rest


class LineRows:
    """The lines of a text from byte ``start`` on, to be taken by the number of rows of each table."""

    def __init__(self, foreign: ForeignBytes, start: int) -> None:
        self._parts, self._share_above_largest = read_whole_lines(foreign, start), b""

    def take(self, count: int) -> Iterator[bytes]:
        """The next ``count`` lines, many at a time. Raises UnusualError if there are fewer."""
        while count:
            text = self._share_above_largest or next(self._parts, b"")
            if not text:
                raise UnusualTextError
            ends = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n")) + 1
            if not text.endswith(b"\n"):
                ends = np.append(ends, len(text))
            cut = int(ends[min(count, len(ends)) - 1])
            text, self._share_above_largest = text[:cut], text[cut:]
            count -= min(count, len(ends))
            yield text


def reduce_digits(text: bytes) -> bytes:
    """The text with one 0 for each run of digits. Raises UnusualError for one with zero bytes, and where a number may
    be too large for double precision: with an exponent of three digits, or hundreds of digits."""
    zeros = text.translate(_DIGITS)
    if b"\0" in text or _MANY_DIGITS in zeros:
        raise UnusualTextError
    values = np.frombuffer(zeros, np.uint8)
    is_digit = values == ord("0")
    if _has_long_exponent(values, is_digit):
        raise UnusualTextError
    kept = values.copy()
    kept[1:] *= ~(is_digit[1:] & is_digit[:-1])
    return kept.tobytes().translate(None, b"\0")


def _has_long_exponent(values: Array, is_digit: Array) -> bool:
    """Whether three digits follow an e, with or without a sign between them."""
    three = is_digit[:-2] & is_digit[1:-1] & is_digit[2:]
    exponent = (values | 0x20) == ord("e")
    sign = (values == ord("+")) | (values == ord("-"))
    return bool((three[1:] & exponent[:-3]).any() or (three[2:] & sign[1:-3] & exponent[:-4]).any())


class LineForms:
    """Forms of lines that ``check`` has passed. It gets a line, and raises ValueError or UnusualError for a bad one."""

    def __init__(self, check: Callable[[bytes], object]) -> None:
        self._check, self._known = check, set[bytes]()

    def check_lines(self, text: bytes) -> None:
        """Check the lines of a reduced text. Raises UnusualError for one that ``check`` does not pass."""
        for form in set(text.removesuffix(b"\n").split(b"\n")) - self._known:
            try:
                self._check(form.removesuffix(b"\r"))
            except ValueError:
                raise UnusualTextError from None
            if len(self._known) < _MOST_FORMS and len(form) <= _LONGEST_FORM:
                self._known.add(form)
