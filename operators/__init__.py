"""The person's verbs: thin operators on the builders, the worker and the evaluator."""

from __future__ import annotations

import bpy

from . import (
    add,
    build,
    dataset,
    evaluate,
    evaluator,
    expose,
    follow,
    ground,
    jobs,
    layers,
    live,
    presets,
    render,
    results,
    settings,
    trade,
)

CLASSES = (*presets.CLASSES, *settings.CLASSES, *build.CLASSES, *ground.CLASSES, *layers.CLASSES, *render.CLASSES,
           *dataset.CLASSES, *evaluate.CLASSES, *expose.CLASSES, *results.CLASSES, *evaluator.CLASSES, *trade.CLASSES,
           *add.CLASSES, *jobs.CLASSES)

_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    """Register the operators."""
    _register()
    jobs.register()
    dataset.register()
    live.register()
    follow.register()


def unregister() -> None:
    """Unregister them; a running worker is stopped."""
    follow.unregister()
    live.unregister()
    dataset.unregister()
    jobs.unregister()
    _unregister()
