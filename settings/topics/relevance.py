"""When a setting is relevant: conditions on other settings, written beside its declaration.

A condition names settings of the same topic by their key and others by ``topic.key``. It is evaluated for the settings
of a scene, as plain data or as ``Scene.icymoon``. Operators ``&``, ``|`` and ``~`` combine conditions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any


@dataclass(frozen=True)
class ConditionScope:
    """Gives a condition the settings of a scene, for a setting in ``topic``. ``root`` contains them by topic."""

    root: object
    topic: str

    def value(self, name: str) -> Any:
        """The value of a setting of the same topic (``key``) or of another topic (``topic.key``)."""
        topic, dot, key = name.partition(".")
        return getattr(getattr(self.root, topic), key) if dot else getattr(getattr(self.root, self.topic), name)


class _Recording(ConditionScope):
    """Records the settings that a condition reads, as ``topic.key``."""

    def value(self, name: str) -> Any:
        self.names[name if "." in name else f"{self.topic}.{name}"] = None
        return super().value(name)

    @cached_property
    def names(self) -> dict[str, None]:
        """The names in the order in which they were read."""
        return {}


@dataclass(frozen=True)
class Condition:
    """A condition on the settings of a scene.

    ``decide`` lists the settings that decide a combination of conditions; without it, all that ``test`` reads decide.
    """

    test: Callable[[ConditionScope], bool]
    decide: Callable[[ConditionScope], tuple[str, ...]] | None = None

    def __call__(self, root: object, topic: str) -> bool:
        """Whether the condition holds for a setting of ``topic``; ``root`` holds all settings."""
        return self.test(ConditionScope(root, topic))

    def list_deciding(self, root: object, topic: str) -> tuple[str, ...]:
        """The settings (``topic.key``) whose present values decide whether the condition holds."""
        if self.decide is not None:
            return self.decide(ConditionScope(root, topic))
        asked = _Recording(root, topic)
        self.test(asked)
        return tuple(asked.names)

    def __and__(self, other: Condition) -> Condition:
        return Condition(
            lambda asked: self.test(asked) and other.test(asked), partial(_list_deciding, (self, other), False)
        )

    def __or__(self, other: Condition) -> Condition:
        return Condition(
            lambda asked: self.test(asked) or other.test(asked), partial(_list_deciding, (self, other), True)
        )

    def __invert__(self) -> Condition:
        return Condition(lambda asked: not self.test(asked), self.decide)


def _list_deciding(parts: tuple[Condition, ...], alone: bool, asked: ConditionScope) -> tuple[str, ...]:
    """The settings that decide whether all or one of the ``parts`` hold: those of the first part with the result
    ``alone``, which decides without the others; without such a part, those of all parts."""
    deciding = next(((part,) for part in parts if part.test(asked) is alone), parts)
    return tuple(dict.fromkeys(name for part in deciding for name in part.list_deciding(asked.root, asked.topic)))


ALWAYS = Condition(lambda asked: True)


def chosen(name: str, *choices: str) -> Condition:
    """The condition that one of these choices is selected."""
    return Condition(lambda asked: asked.value(name) in choices)


def ticked(name: str) -> Condition:
    """The condition that a tick is set."""
    return Condition(lambda asked: bool(asked.value(name)))


def positive(name: str) -> Condition:
    """The condition that a number is above 0."""
    return Condition(lambda asked: asked.value(name) > 0)


def nonzero(*names: str) -> Condition:
    """The condition that one of these numbers differs from 0."""
    return Condition(lambda asked: any(asked.value(name) != 0 for name in names))


def of_topic(topic: str) -> Condition:
    """The condition that the setting belongs to this topic, not to another topic with the same settings."""
    return Condition(lambda asked: asked.topic == topic)
