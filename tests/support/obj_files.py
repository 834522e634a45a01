"""OBJ files of tests."""

from __future__ import annotations

from pathlib import Path

from icymoon.support.arrays import Array


def obj(path: Path, positions: Array, faces: Array, uv: Array | None, head: str = "") -> Path:
    lines = [head, *(f"v {a!r} {b!r} {c!r}" for a, b, c in positions.tolist())]
    if uv is not None:
        lines += [f"vt {u!r} {v!r}" for u, v in uv.reshape(-1, 2).tolist()]
    for k, face in enumerate(faces.tolist()):
        lines.append(
            "f " + " ".join(f"{v + 1}" if uv is None else f"{v + 1}/{3 * k + j + 1}" for j, v in enumerate(face))
        )
    path.write_text("\n".join(lines) + "\n")
    return path
