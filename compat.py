"""Every difference between Blender 4.2 and 5.2 that this extension meets, and nothing else.

Differences are found by feature, not by version number.
"""

from __future__ import annotations

from typing import Any

import bpy


def path_options() -> set[str]:
    """Options of a folder property: ``//`` paths need a flag that 4.2 does not know."""
    return {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()


def ensure_nodes(data_block: Any) -> Any:
    """The node tree of a new material or world, made if this Blender does not make it itself."""
    if data_block.node_tree is None:
        data_block.use_nodes = True
    return data_block.node_tree


def use_multilayer_exr(image_settings: Any) -> None:
    """Choose multilayer OpenEXR; from 5.0 the media type comes first."""
    if hasattr(image_settings, "media_type"):
        image_settings.media_type = "MULTI_LAYER_IMAGE"
    image_settings.file_format = "OPEN_EXR_MULTILAYER"


def plain_light(light: Any) -> None:
    """Switch off what later Blenders multiply a lamp's energy with (exposure, temperature)."""
    if hasattr(light, "exposure"):
        light.exposure = 0.0
    if hasattr(light, "use_temperature"):
        light.use_temperature = False


def has_osl() -> bool:
    """Whether Cycles was built with Open Shading Language; without it script nodes render black."""
    try:
        import _cycles
    except ImportError:
        return False
    return bool(_cycles.with_osl)


def has_oidn() -> bool:
    """Whether Cycles was built with OpenImageDenoise; without it a denoised render fails."""
    try:
        import _cycles
    except ImportError:
        return False
    return bool(getattr(_cycles, "with_openimagedenoise", False))


def gpu_devices() -> list[str]:
    """Names of the graphics cards that Cycles can render on, of the first backend that has any.

    Selects that backend and its cards in this session's preferences, which are not saved.
    """
    add_on = bpy.context.preferences.addons.get("cycles")
    if add_on is None:
        return []
    cycles = add_on.preferences
    for backend in ("OPTIX", "CUDA", "HIP", "METAL", "ONEAPI"):
        try:
            cycles.compute_device_type = backend
        except TypeError:
            continue  # this build does not know the backend
        cards = [d for d in cycles.get_devices_for_type(backend) if d.type == backend]
        if cards:
            for device in cycles.devices:
                device.use = device.type == backend
            return [card.name for card in cards]
    cycles.compute_device_type = "NONE"
    return []
