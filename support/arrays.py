"""The type of numpy's arrays in annotations; docstrings state shapes, units and kinds of numbers."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

#: An array of any shape and any kind of number.
Array = npt.NDArray[Any]
#: A number, or an array that broadcasts.
Numbers = Array | float
