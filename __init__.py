"""Icy Moon: icy-moon landing sites seen by a stereo camera, with exact truth and measured stereo error.

The repository root is the Blender extension and the Python package ``icymoon``. Nothing of Blender
is imported before ``register``, so that the evaluator and the command line can use the package
from any Python.
"""

from __future__ import annotations

import atexit


def register() -> None:
    """Called by Blender when the extension is enabled."""
    from . import compat, operators, panels, preferences, scene_properties

    scene_properties.register()
    preferences.register()
    operators.register()
    panels.register()
    if compat.is_module():
        # A handler that is alive when Python ends crashes the 4.2 wheel and hangs the 4.5 one.
        atexit.register(unregister)


def unregister() -> None:
    """Called by Blender when the extension is disabled; undoes ``register`` in reverse."""
    from . import operators, panels, preferences, scene_properties

    atexit.unregister(unregister)
    panels.unregister()
    operators.unregister()
    preferences.unregister()
    scene_properties.unregister()
