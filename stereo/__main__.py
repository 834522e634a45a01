"""``python -m icymoon.stereo …``, and the same by path where the package is not importable by name.

Blender keeps an extension in a folder of its own choosing, on no other Python's path. So when this
file is run by path, the folder above it is loaded as the package ``icymoon``, whatever its name.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path


def _load_package() -> None:
    root = Path(__file__).resolve().parents[1]
    # Python put this folder first on the path; its modules must not pass for top-level ones.
    sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != Path(__file__).resolve().parent]
    spec = importlib.util.spec_from_file_location("icymoon", root / "__init__.py",
                                                  submodule_search_locations=[str(root)])
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules["icymoon"] = package
    spec.loader.exec_module(package)


if __name__ == "__main__":
    if not __package__:
        _load_package()
    from icymoon.stereo.cli import main

    sys.exit(main())
