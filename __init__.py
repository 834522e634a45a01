"""Icy Moon: icy-moon landing sites seen by a stereo camera, with exact truth and measured stereo error.

The repository root is the Blender extension and the Python package ``icymoon``. Nothing of Blender
is imported before ``register``, so that the evaluator and the command line can use the package
from any Python.
"""

from __future__ import annotations


def register() -> None:
    """Called by Blender when the extension is enabled."""
    from . import operators, panels, preferences, properties

    properties.register()
    preferences.register()
    operators.register()
    panels.register()


def unregister() -> None:
    """Called by Blender when the extension is disabled; undoes ``register`` in reverse."""
    from . import operators, panels, preferences, properties

    panels.unregister()
    operators.unregister()
    preferences.unregister()
    properties.unregister()
