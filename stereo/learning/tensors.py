"""Samples as tensors of PyTorch, which is imported for the first sample."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...support.errors import IcyMoonError


def require_torch() -> None:
    """Raise IcyMoonError if PyTorch is missing."""
    try:
        import torch  # noqa: F401
    except ImportError:
        raise IcyMoonError(
            'Training samples are tensors of PyTorch, which is not installed; run: pip install "icymoon[networks]".'
        ) from None


def to_tensors(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return a sample with its arrays as tensors. Raises IcyMoonError if PyTorch is missing."""
    require_torch()
    import torch

    return {
        key: torch.from_numpy(np.ascontiguousarray(value)) if isinstance(value, np.ndarray) else value
        for key, value in found.items()
    }
