"""The operators behind buttons and F3: thin functions that call the builders, the worker and the evaluator."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import bpy

from . import (
    add_mesh,
    appended_scenes,
    build,
    build_in_pieces,
    build_scene,
    calibrations,
    coloured_views,
    dataset,
    decide,
    decisions_in_view,
    errors_in_view,
    evaluate,
    evaluator_python,
    export_pairs,
    full_undo,
    image_editor,
    import_ground,
    job_operators,
    keep_marks,
    lamp_list,
    lidar,
    live_exposure,
    live_preview,
    make_asset_library,
    manual,
    noise_layers,
    object_as_ground,
    object_as_rock,
    open_tab,
    painted_masks,
    place_on_ground,
    presets,
    recent_pairs,
    recolour_errors,
    refine_ground,
    render,
    render_variations,
    reproduce,
    results,
    session,
    settings_files,
    shadow_warning,
    show_camera_image,
    show_pair,
    trade,
    trajectory,
    unseen_jobs,
    variation_curves,
    variation_pictures,
    variation_plan,
    varied_settings,
    view_exposure,
    view_resolution,
    window_events,
)

CLASSES: tuple[Any, ...] = (
    *presets.CLASSES,
    *settings_files.CLASSES,
    *build_scene.CLASSES,
    *import_ground.CLASSES,
    *object_as_ground.CLASSES,
    *object_as_rock.CLASSES,
    *painted_masks.CLASSES,
    *place_on_ground.CLASSES,
    *lamp_list.CLASSES,
    *lidar.CLASSES,
    *noise_layers.CLASSES,
    *render.CLASSES,
    *show_pair.CLASSES,
    *dataset.CLASSES,
    *reproduce.CLASSES,
    *evaluate.CLASSES,
    *decide.CLASSES,
    *export_pairs.CLASSES,
    *show_camera_image.CLASSES,
    *results.CLASSES,
    *errors_in_view.CLASSES,
    *decisions_in_view.CLASSES,
    *evaluator_python.CLASSES,
    *make_asset_library.CLASSES,
    *trade.CLASSES,
    *trajectory.CLASSES,
    *calibrations.CLASSES,
    *add_mesh.CLASSES,
    *varied_settings.CLASSES,
    *variation_plan.CLASSES,
    *render_variations.CLASSES,
    *variation_curves.CLASSES,
    *variation_pictures.CLASSES,
    *job_operators.CLASSES,
    *manual.CLASSES,
)

if find_spec(f"{__package__}.install_evaluator"):  # a store build lacks this module
    from . import install_evaluator

    CLASSES = (*CLASSES, *install_evaluator.CLASSES)

_register, _unregister = bpy.utils.register_classes_factory(CLASSES)

#: The modules that follow events, in the order in which they learn of a change.
_EVENT_MODULES: tuple[Any, ...] = (
    window_events,
    session,
    full_undo,
    unseen_jobs,
    build,
    build_in_pieces,
    coloured_views,
    dataset,
    live_preview,
    view_exposure,
    view_resolution,
    keep_marks,
    refine_ground,
    shadow_warning,
    appended_scenes,
    live_exposure,
    image_editor,
    show_pair,
    recolour_errors,
    lidar,
    manual,
    open_tab,
    recent_pairs,
)


def register() -> None:
    """Register the operators, and follow events."""
    _register()
    for module in _EVENT_MODULES:
        module.register()


def unregister() -> None:
    """Stop following events, stop running jobs and unregister the operators."""
    for module in reversed(_EVENT_MODULES):
        module.unregister()
    variation_pictures.unregister()
    _unregister()
