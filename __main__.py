"""``python -m icymoon …``, also when this file is run by its path.

Inside Blender (``blender -b --python __main__.py -- worker job.json``) and in another Python the
package's folder has any name and is on no search path; it is then loaded as ``icymoon`` from here.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path


def _load_package() -> None:
    root = Path(__file__).resolve().parent
    spec = importlib.util.spec_from_file_location("icymoon", root / "__init__.py",
                                                  submodule_search_locations=[str(root)])
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules["icymoon"] = package
    spec.loader.exec_module(package)


def _arguments() -> list[str]:
    inside_blender = "bpy" in sys.modules
    if inside_blender:
        return sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else []
    return sys.argv[1:]


if __name__ == "__main__":
    if not __package__:
        sys.path[:] = [p for p in sys.path if Path(p or ".").resolve() != Path(__file__).resolve().parent]
        _load_package()
    from icymoon.cli import main

    sys.exit(main(_arguments()))
