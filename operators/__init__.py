"""What buttons and F3 do: thin operators that call the builders, the worker and the evaluator."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import bpy

from . import (
    add,
    assets,
    build,
    coloured_views,
    dataset,
    decide,
    decisions_in_view,
    errors_in_view,
    evaluate,
    evaluator,
    expose,
    first_picture,
    ground,
    jobs,
    layers,
    live_exposure,
    live_preview,
    manual,
    presets,
    refine,
    render,
    results,
    settings,
    show_pair,
    trade,
    variation_pictures,
    vary,
    view_exposure,
    view_resolution,
)

CLASSES: tuple[Any, ...] = (
    *presets.CLASSES,
    *settings.CLASSES,
    *build.CLASSES,
    *ground.CLASSES,
    *layers.CLASSES,
    *render.CLASSES,
    *show_pair.CLASSES,
    *dataset.CLASSES,
    *evaluate.CLASSES,
    *decide.CLASSES,
    *expose.CLASSES,
    *results.CLASSES,
    *errors_in_view.CLASSES,
    *decisions_in_view.CLASSES,
    *evaluator.CLASSES,
    *assets.CLASSES,
    *trade.CLASSES,
    *add.CLASSES,
    *vary.CLASSES,
    *variation_pictures.CLASSES,
    *jobs.CLASSES,
    *manual.CLASSES,
)

if find_spec(f"{__package__}.install_evaluator"):  # a store build has it not
    from . import install_evaluator

    CLASSES = (*CLASSES, *install_evaluator.CLASSES)

_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    """Register the operators."""
    _register()
    build.register()
    coloured_views.register()
    jobs.register()
    dataset.register()
    live_preview.register()
    view_exposure.register()
    view_resolution.register()
    first_picture.register()
    refine.register()
    live_exposure.register()
    show_pair.register()
    vary.register()
    variation_pictures.register()
    errors_in_view.register()
    manual.register()


def unregister() -> None:
    """Unregister the operators and stop a running job."""
    manual.unregister()
    errors_in_view.unregister()
    variation_pictures.unregister()
    vary.unregister()
    show_pair.unregister()
    live_exposure.unregister()
    refine.unregister()
    first_picture.unregister()
    view_resolution.unregister()
    view_exposure.unregister()
    live_preview.unregister()
    dataset.unregister()
    jobs.unregister()
    coloured_views.unregister()
    build.unregister()
    _unregister()
