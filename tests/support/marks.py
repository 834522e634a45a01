"""Which cases of a test `make test` runs; the others are for `make test-ci`, CI and `make test-all`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def heavy_but(quick: Iterable[Any], values: Iterable[Any], long: Iterable[Any] = ()) -> list[Any]:
    """The values as cases for ``parametrize``: those that are not ``quick`` are heavy, ``long`` ones not for CI."""
    quick, values, long = list(quick), list(values), list(long)
    assert all(value in values for value in quick + long), f"not among the cases: {quick}, {long}"
    return [
        value
        if value in quick
        else pytest.param(
            *(value if isinstance(value, tuple) else (value,)),
            marks=[pytest.mark.heavy, *[pytest.mark.long] * (value in long)],
        )
        for value in values
    ]
