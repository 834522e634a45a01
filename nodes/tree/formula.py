"""Formulas as nodes: an expression in Python that adds the nodes for it to a tree.

A number is a constant or the output of a node. Constants are computed when the tree is built. A product with one and a
sum with zero add no nodes, so that terms which are switched off cost nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import bpy

from .builder import Tree


class Number:
    """A number in a formula: a constant, or the output of a node."""

    def __init__(self, tree: Tree, value: float | bpy.types.NodeSocket) -> None:
        self.tree, self.value = tree, value

    @property
    def known(self) -> float | None:
        """The value of a constant; None for the output of a node."""
        return self.value if isinstance(self.value, (int, float)) else None

    def named(self, name: str) -> Number:
        """Return the same number, with its name in the formula as the label of its node."""
        if not isinstance(self.value, (int, float)) and self.value.node.label != name:
            self.value.node.label = name
        return self

    def _of(self, other: Number | float) -> Number:
        return other if isinstance(other, Number) else Number(self.tree, other)

    def _node(self, operation: str, *others: Number | float, known: Callable[..., float] | None = None) -> Number:
        terms = (self, *(self._of(other) for other in others))
        values = [term.known for term in terms]
        if known is not None and None not in values:
            return Number(self.tree, known(*values))
        return Number(self.tree, self.tree.math(operation, operation.capitalize(), *(term.value for term in terms)))

    def __add__(self, other: Number | float) -> Number:
        other = self._of(other)
        if self.known == 0.0 or other.known == 0.0:
            return other if self.known == 0.0 else self
        return self._node("ADD", other, known=lambda a, b: a + b)

    def __sub__(self, other: Number | float) -> Number:
        other = self._of(other)
        return self if other.known == 0.0 else self._node("SUBTRACT", other, known=lambda a, b: a - b)

    def __mul__(self, other: Number | float) -> Number:
        other = self._of(other)
        if self.known in (0.0, 1.0):
            return other if self.known == 1.0 else self
        if other.known in (0.0, 1.0):
            return self if other.known == 1.0 else other
        return self._node("MULTIPLY", other, known=lambda a, b: a * b)

    def __truediv__(self, other: Number | float) -> Number:
        other = self._of(other)
        if other.known is not None:
            return self * (1.0 / other.known)
        return self if self.known == 0.0 else self._node("DIVIDE", other)

    def __neg__(self) -> Number:
        return self * -1.0

    def __radd__(self, other: float) -> Number:
        return self._of(other) + self

    def __rsub__(self, other: float) -> Number:
        return self._of(other) - self

    def __rmul__(self, other: float) -> Number:
        return self._of(other) * self

    def __rtruediv__(self, other: float) -> Number:
        return self._of(other) / self

    def times_plus(self, factor: Number | float, term: Number | float) -> Number:
        """Return self * factor + term, in one node."""
        factor, term = self._of(factor), self._of(term)
        if (
            term.known == 0.0
            or any(part.known in (0.0, 1.0) for part in (self, factor))
            or (self.known is not None and factor.known is not None)
        ):
            return self * factor + term
        return self._node("MULTIPLY_ADD", factor, term)

    def sqrt(self) -> Number:
        """Return the square root."""
        return self._node("SQRT", known=math.sqrt)

    def exp(self) -> Number:
        """Return the exponential function."""
        return self._node("EXPONENT", known=math.exp)

    def log(self) -> Number:
        """Return the natural logarithm."""
        return self._node("LOGARITHM", math.e, known=lambda a, _: math.log(a))

    def tangent(self) -> Number:
        """Return the tangent of an angle in radians, of at most 60 degrees, with an error of 3e-9.

        It is Lambert's continued fraction up to the seventh term, since OSL's own tangent has only four digits.
        """
        if self.known is not None:
            return Number(self.tree, math.tan(self.known))
        y = self * self
        over = y.times_plus(y.times_plus(21.0, -1260.0), 10395.0) * self
        return over / y.times_plus(y.times_plus(210.0 - y, -4725.0), 10395.0)

    def power(self, exponent: Number | float) -> Number:
        """Return a power of the number, which must not be negative."""
        return self._node("POWER", exponent, known=math.pow)

    def arctan2(self, other: Number) -> Number:
        """Return the angle in radians from the x axis to the point (other, self)."""
        return self._node("ARCTAN2", other)

    def at_least(self, other: Number | float) -> Number:
        """Return the larger of two numbers."""
        return self._node("MAXIMUM", other, known=max)

    def at_most(self, other: Number | float) -> Number:
        """Return the smaller of two numbers."""
        return self._node("MINIMUM", other, known=min)

    def exceeds(self, other: Number | float) -> Number:
        """Return 1 where this number is larger than the other, otherwise 0."""
        return self._node("GREATER_THAN", other, known=lambda a, b: float(a > b))


class Vector:
    """A vector in a formula: the output of a node."""

    def __init__(self, tree: Tree, socket: bpy.types.NodeSocket) -> None:
        self.tree, self.socket = tree, socket

    def _node(self, operation: str, *others: Vector) -> bpy.types.NodeSocket:
        sockets = (each.socket for each in (self, *others))
        return self.tree.vector(operation, operation.capitalize(), *sockets)

    def __add__(self, other: Vector) -> Vector:
        return Vector(self.tree, self._node("ADD", other))

    def cross(self, other: Vector) -> Vector:
        """Return the cross product with another vector."""
        return Vector(self.tree, self._node("CROSS_PRODUCT", other))

    def unit(self) -> Vector:
        """Return the vector of length one in this direction; zero for the zero vector."""
        return Vector(self.tree, self._node("NORMALIZE"))

    def dot(self, other: Vector) -> Number:
        """Return the scalar product with another vector."""
        return Number(self.tree, self._node("DOT_PRODUCT", other))

    def distance(self, other: Vector) -> Number:
        """Return the distance to another vector."""
        return Number(self.tree, self._node("DISTANCE", other))

    def length(self) -> Number:
        """Return the length of the vector."""
        return Number(self.tree, self._node("LENGTH"))
