"""Every difference between Blender 4.2 and 5.2 that this extension meets, and nothing else.

Differences are found by feature, not by version number.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy


def path_options() -> set[str]:
    """Options of a folder property: ``//`` paths need a flag that 4.2 does not know."""
    return {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()


def principled_table() -> str:
    """The key of ``principled.TABLES`` for this Blender, which only its version tells."""
    if bpy.app.version < (4, 3, 0):
        return "4.2"
    return "5.2" if bpy.app.version >= (5, 2, 0) else "5.0"


def blender_series() -> str:
    """The Blenders that have the same properties as this one, such as 5.0."""
    return f"{bpy.app.version[0]}.{bpy.app.version[1]}"


def custom_properties(struct: Any) -> list[str]:
    """Names of a structure's custom properties; modifiers have none from 5.2 on."""
    try:
        return list(struct.keys())
    except TypeError:
        return []


def is_module() -> bool:
    """Whether Blender runs as a Python module; before 4.3 only its lack of a program tells."""
    return bool(getattr(bpy.app, "module", not bpy.app.binary_path))


def ensure_nodes(data_block: Any) -> Any:
    """The node tree of a new material or world, made if this Blender does not make it itself."""
    if data_block.node_tree is None:
        data_block.use_nodes = True
    return data_block.node_tree


def uses_nodes(material: Any) -> bool:
    """Whether Cycles shows a material's nodes, which from 5.0 on it always does."""
    return bpy.app.version >= (5, 0, 0) or bool(material.use_nodes)


def ensure_light_nodes(light: Any) -> Any:
    """The node tree of a lamp, which does nothing until it is switched on."""
    light.use_nodes = True
    return light.node_tree


def use_multilayer_exr(image_settings: Any) -> None:
    """Choose multilayer OpenEXR; from 5.0 the media type comes first."""
    if hasattr(image_settings, "media_type"):
        image_settings.media_type = "MULTI_LAYER_IMAGE"
    image_settings.file_format = "OPEN_EXR_MULTILAYER"


def disable_light_factors(light: Any) -> None:
    """Switch off what later Blenders multiply a lamp's energy with (exposure, temperature)."""
    if hasattr(light, "exposure"):
        light.exposure = 0.0
    if hasattr(light, "use_temperature"):
        light.use_temperature = False


def has_cycles() -> bool:
    """Whether the add-on that brings Cycles is on."""
    return hasattr(bpy.types.Scene, "cycles")


def has_osl() -> bool:
    """Whether Cycles was built with Open Shading Language; without it script nodes render black."""
    try:
        import _cycles
    except ImportError:
        return False
    return bool(_cycles.with_osl)


def compile_osl(source: Path, target: Path) -> bool:
    """Compile a shader with Cycles' own compiler; the wheels from 4.5 on lack what Blender's Python uses for it."""
    import _cycles

    return bool(_cycles.osl_compile(str(source), str(target)))


def has_oidn() -> bool:
    """Whether Cycles was built with OpenImageDenoise; without it a denoised render fails."""
    try:
        import _cycles
    except ImportError:
        return False
    return bool(getattr(_cycles, "with_openimagedenoise", False))


def select_gpu_devices() -> list[str]:
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


def find_mesh_importer(kind: str) -> tuple[Any, dict[str, Any]] | None:
    """The operator that reads a kind of mesh file and its options, or None if this Blender has none.

    OBJ, PLY and STL keep their coordinates, the others are turned as their own header states. Meshes
    are not validated where that can be left out: validation would hide what is wrong with them.
    """
    as_is = {"forward_axis": "Y", "up_axis": "Z"}
    candidates: dict[str, tuple[tuple[str, str, dict[str, Any]], ...]] = {
        "OBJ": (("wm", "obj_import", {**as_is, "validate_meshes": False}),),
        "PLY": (("wm", "ply_import", as_is),),
        "STL": (("wm", "stl_import", {**as_is, "use_mesh_validate": False}),),
        "glTF": (("import_scene", "gltf", {}),),
        "USD": (("wm", "usd_import", {"import_materials": False, "import_lights": False, "import_cameras": False}),),
        "FBX": (("wm", "fbx_import", {}), ("import_scene", "fbx", {"use_image_search": False})),
    }
    for module, name, options in candidates[kind]:
        operator = getattr(getattr(bpy.ops, module), name)
        try:
            known = operator.get_rna_type().properties
        except KeyError:
            continue  # from 5.0 on FBX is read by wm; a build may leave a format out
        return operator, {key: value for key, value in options.items() if key in known}
    return None


def applies_usd_unit() -> bool:
    """Whether the USD importer turns the unit that the file states into metres (from 4.5 on)."""
    found = find_mesh_importer("USD")
    return found is not None and "apply_unit_conversion_scale" in found[0].get_rna_type().properties


#: What Normal Map nodes have from 5.1 on: green up, and the mesh before displacement, as it always was.
NORMAL_MAP = {name: value for name, value in (("convention", "OPENGL"), ("base", "ORIGINAL"))
              if name in bpy.types.ShaderNodeNormalMap.bl_rna.properties}

#: The add-on that reads a format which Blender itself does not.
IMPORT_ADD_ONS = {"glTF": "io_scene_gltf2", "FBX": "io_scene_fbx"}
