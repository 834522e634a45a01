"""The options of matchers. Each is declared once; its value, which may be text, is checked before anything runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...settings.topics.trust_boundary import LOADING_OPTIONS
from ...support.errors import IcyMoonError
from ...support.files import quote
from ...support.suggestions import suggest_nearest


@dataclass(frozen=True)
class Option:
    """One option: a whole number (any number if the default is a float), one of ``choices``, or text.

    With ``words`` it is a whole number or one of these words. ``opencv`` is its name in OpenCV's manual, which is
    accepted too. A text option must be one of ``trust_boundary.LOADING_OPTIONS``, which no scene or file may set.
    """

    key: str
    default: int | float | str
    doc: str
    minimum: float = 0
    maximum: float = 0
    step: int = 1  # values are minimum + a multiple of this
    choices: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    opencv: str = ""

    def __post_init__(self) -> None:
        is_text = isinstance(self.default, str) and not self.choices and not self.words
        if is_text != (self.key in LOADING_OPTIONS) or (is_text and self.opencv):
            raise ValueError(
                f"{self.key}: options that are text, and only these, are in trust_boundary.LOADING_OPTIONS, "
                "without a second name."
            )

    @property
    def range(self) -> str:
        """The accepted values, in words."""
        if self.choices:
            return ", ".join(self.choices)
        if isinstance(self.default, str) and not self.words:
            return "text"
        numbers = f"{self.minimum} to {self.maximum}" + (f" in steps of {self.step}" if self.step > 1 else "")
        return ", ".join((*self.words, numbers))


def resolve_options(
    method: str, declared: Sequence[Option], presets: Mapping[str, Mapping[str, Any]], given: Mapping[str, Any]
) -> dict[str, Any]:
    """Resolve all options of a matcher: the defaults, overridden by a ``preset``, then by the other ``given`` options.

    Values may be text. Raises IcyMoonError for an unknown option or preset, or a bad value.
    """
    names = {name: option for option in declared for name in (option.key, option.opencv) if name}
    complete: dict[str, Any] = {option.key: option.default for option in declared}
    known = {*names, "preset"} if presets else set(names)
    for key in given:
        if key not in known:
            own = [option.key for option in declared]
            raise IcyMoonError(f"Unknown option {method}.{key}, {suggest_nearest(key, own)}")
    if "preset" in given:
        if given["preset"] not in presets:
            raise IcyMoonError(
                f"Unknown preset {method}.preset={given['preset']}, {suggest_nearest(str(given['preset']), presets)}"
            )
        complete |= presets[given["preset"]]
    for key, value in given.items():
        if key != "preset":
            complete[names[key].key] = _parse_value(method, names[key], value)
    return complete


def _parse_value(method: str, option: Option, value: Any) -> int | float | str:
    name = f"{method}.{option.key}"
    if option.choices:
        if value not in option.choices:
            raise IcyMoonError(f"{name} is {quote(value)}, {suggest_nearest(str(value), option.choices)}")
        return str(value)
    if value in option.words:
        return str(value)
    if isinstance(option.default, str) and not option.words:
        return str(value)
    whole = not isinstance(option.default, float)
    try:
        number = int(str(value)) if whole else float(value)
    except (TypeError, ValueError):
        kinds = [*option.words, f"a {'whole ' if whole else ''}number"]
        raise IcyMoonError(f"{name} must be {' or '.join(kinds)}, not {quote(value)}.") from None
    if not option.minimum <= number <= option.maximum or (whole and (number - option.minimum) % option.step):
        raise IcyMoonError(f"{name} is {quote(number)}, outside {option.range}.")
    return number
