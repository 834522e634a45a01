"""Icy Moon: icy-moon landing sites seen by a stereo camera, with exact truth and measured stereo error.

The repository root is the Blender extension and the Python package ``icymoon``. Nothing of Blender
is imported before ``register``, so that the evaluator and the command line can use the package
from any Python. A name for programs and notebooks is imported at its first use.
"""

from __future__ import annotations

import atexit
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .library.evaluation import Evaluation, evaluate
    from .library.ground import export_ground
    from .library.landed_day import open_landed_day
    from .library.rendered_pair import RenderedEye, RenderedPair, open_pair, open_pairs
    from .library.renderers import InProcess, Worker
    from .library.scene import Scene
    from .library.sweep import Sweep, SweepPoint
    from .settings.preset_files import preset_names
    from .stereo import torch_data as torch
    from .support.errors import IcyMoonError

#: The module of each public name.
_NAMES = {
    "Evaluation": "library.evaluation",
    "IcyMoonError": "support.errors",
    "InProcess": "library.renderers",
    "RenderedEye": "library.rendered_pair",
    "RenderedPair": "library.rendered_pair",
    "Scene": "library.scene",
    "Sweep": "library.sweep",
    "SweepPoint": "library.sweep",
    "Worker": "library.renderers",
    "evaluate": "library.evaluation",
    "export_ground": "library.ground",
    "open_landed_day": "library.landed_day",
    "open_pair": "library.rendered_pair",
    "open_pairs": "library.rendered_pair",
    "preset_names": "settings.preset_files",
}
#: The module ``icymoon.torch``. A file ``torch.py`` at the root would hide PyTorch from programs that run there.
_MODULES = {"torch": "stereo.torch_data"}

__all__ = [
    "Evaluation",
    "IcyMoonError",
    "InProcess",
    "RenderedEye",
    "RenderedPair",
    "Scene",
    "Sweep",
    "SweepPoint",
    "Worker",
    "evaluate",
    "export_ground",
    "open_landed_day",
    "open_pair",
    "open_pairs",
    "preset_names",
    "torch",
]


def __getattr__(name: str) -> object:
    import importlib

    if name in _MODULES:
        return importlib.import_module(f".{_MODULES[name]}", __name__)
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_NAMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def register() -> None:
    """Register the extension. Blender calls this when the extension is enabled."""
    from . import operators, panels
    from .operators import preferences
    from .settings.blender import scene_properties
    from .support.blender import compat

    scene_properties.register()
    preferences.register()
    operators.register()
    panels.register()
    if compat.is_module():
        # A handler that is alive when Python ends crashes the 4.2 wheel and hangs the 4.5 one.
        atexit.register(unregister)


def unregister() -> None:
    """Undo ``register`` in reverse order. Blender calls this when the extension is disabled."""
    from . import operators, panels
    from .operators import preferences
    from .settings.blender import scene_properties

    atexit.unregister(unregister)
    panels.unregister()
    operators.unregister()
    preferences.unregister()
    scene_properties.unregister()
