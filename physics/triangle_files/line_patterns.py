"""Check large mesh files fast, by the few patterns of their many lines of numbers.

A pattern is a line with each run of digits replaced by one 0. Whether the words of a line are numbers depends neither
on the digits nor on their count. A large mesh has few patterns, so the patterns are checked instead of millions of
lines. A text that is unusual in any way is left to the check line by line, which finds the line at fault.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ...support.arrays import Array
from ...support.foreign_bytes import LONGEST_LINE_BYTES, ForeignBytes

#: Number of bytes that are processed together; they fit the processor's cache.
_BYTES_AT_ONCE = 2**16
#: Maximum number of patterns that are kept.
_MAX_PATTERNS = 10_000
#: Longest pattern that is kept, in bytes.
_LONGEST_PATTERN = 200
_WINDOW_BYTES = LONGEST_LINE_BYTES // 2
_TOO_MANY_DIGITS = b"0" * 300
_DIGITS_TO_ZERO = bytes.maketrans(b"123456789", b"0" * 9)


class UnusualTextError(Exception):
    """Raised for a text that must be checked line by line."""


def read_whole_lines(foreign: ForeignBytes, start: int = 0) -> Iterator[bytes]:
    """Yield a text from byte ``start`` on, in parts that end with a line.

    Raises UnusualTextError where lines may be longer than ``LONGEST_LINE_BYTES``, or do not end in \\n.
    """
    rest = b""
    for at in range(start, foreign.size, _BYTES_AT_ONCE):
        data = rest + foreign.part(at, min(_BYTES_AT_ONCE, foreign.size - at))
        # A line that is too long fills one of these windows.
        if any(data.find(b"\n", k, k + _WINDOW_BYTES) < 0 for k in range(0, len(data) - _WINDOW_BYTES, _WINDOW_BYTES)):
            raise UnusualTextError
        end = data.rfind(b"\n") + 1
        if end:
            yield data[:end]
        rest = data[end:]
    if rest:
        yield rest


class LineRows:
    """The lines of a text from byte ``start`` on, taken in groups, one for each table."""

    def __init__(self, foreign: ForeignBytes, start: int) -> None:
        self._parts, self._rest = read_whole_lines(foreign, start), b""

    def take(self, count: int) -> Iterator[bytes]:
        """Yield the next ``count`` lines, many at a time. Raises UnusualTextError if there are fewer."""
        while count:
            text = self._rest or next(self._parts, b"")
            if not text:
                raise UnusualTextError
            ends = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n")) + 1
            if not text.endswith(b"\n"):
                ends = np.append(ends, len(text))
            cut = int(ends[min(count, len(ends)) - 1])
            text, self._rest = text[:cut], text[cut:]
            count -= min(count, len(ends))
            yield text


def reduce_digits(text: bytes) -> bytes:
    """Replace each run of digits by one 0. Raises UnusualTextError for a text with zero bytes, and where a number
    may be too large for double precision: with an exponent of three digits, or hundreds of digits."""
    zeros = text.translate(_DIGITS_TO_ZERO)
    if b"\0" in text or _TOO_MANY_DIGITS in zeros:
        raise UnusualTextError
    values = np.frombuffer(zeros, np.uint8)
    is_digit = values == ord("0")
    if _has_long_exponent(values, is_digit):
        raise UnusualTextError
    kept = values.copy()
    kept[1:] *= ~(is_digit[1:] & is_digit[:-1])
    return kept.tobytes().translate(None, b"\0")


def _has_long_exponent(values: Array, is_digit: Array) -> bool:
    """Return whether three digits follow an e anywhere, with or without a sign between them."""
    three = is_digit[:-2] & is_digit[1:-1] & is_digit[2:]
    exponent = (values | 0x20) == ord("e")
    sign = (values == ord("+")) | (values == ord("-"))
    return bool((three[1:] & exponent[:-3]).any() or (three[2:] & sign[1:-3] & exponent[:-4]).any())


class LinePatterns:
    """Patterns of lines that ``check`` has passed.

    ``check`` gets a line, and raises ValueError or UnusualTextError for a wrong line.
    """

    def __init__(self, check: Callable[[bytes], object]) -> None:
        self._check, self._known = check, set[bytes]()

    def check_lines(self, text: bytes) -> None:
        """Check the lines of a reduced text. Raises UnusualTextError for a line that ``check`` does not pass."""
        for pattern in set(text.removesuffix(b"\n").split(b"\n")) - self._known:
            try:
                self._check(pattern.removesuffix(b"\r"))
            except ValueError:
                raise UnusualTextError from None
            if len(self._known) < _MAX_PATTERNS and len(pattern) <= _LONGEST_PATTERN:
                self._known.add(pattern)
