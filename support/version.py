"""The version of Icy Moon, which the manifest states."""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def version() -> str:
    """Return the version of Icy Moon, as in ``blender_manifest.toml``."""
    return str(tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"])


def is_newer(other: str) -> bool:
    """Return whether a version such as '1.2.0' is later than this one; False for a text that is not a version."""
    try:
        return tuple(map(int, other.split("."))) > tuple(map(int, version().split(".")))
    except ValueError:
        return False
