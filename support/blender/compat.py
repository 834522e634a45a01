"""All differences between Blender 4.2 and 5.2 that matter to this extension.

They are detected by feature where possible, otherwise by version number.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

if TYPE_CHECKING:
    import gpu


def list_path_options() -> set[str]:
    """List the options of a path property: from 4.5 on, paths with ``//`` need a flag."""
    return {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()


def choose_principled_table() -> str:
    """Choose the key of ``principled.TABLE_FILES`` for this version of Blender."""
    if bpy.app.version < (4, 3, 0):
        return "4.2"
    return "5.2" if bpy.app.version >= (5, 2, 0) else "5.0"


def moves_along_first_corner() -> bool:
    """Return whether Cycles displaces a vertex along the normal of its first corner (from 5.2 on) instead of the
    vertex's normal. The two differ for flat facets."""
    return bpy.app.version >= (5, 2, 0)


def find_series() -> str:
    """Return the series of this Blender, such as 5.0. All versions of a series have the same properties."""
    return f"{bpy.app.version[0]}.{bpy.app.version[1]}"


def has_append_handler() -> bool:
    """Return whether Blender tells add-ons that data-blocks were appended or linked (from 4.3 on)."""
    return hasattr(bpy.app.handlers, "blend_import_post")


def list_custom_properties(struct: bpy.types.bpy_struct) -> list[str]:
    """List the names of the custom properties of a structure. From 5.2 on, modifiers have none."""
    try:
        return list(struct.keys())
    except TypeError:
        return []


def read_stored_groups(group: bpy.types.PropertyGroup) -> dict[str, dict[str, Any]]:
    """Read the values in the sub-groups of a property group, also in sub-groups that are no longer registered.

    From 5.0 on, sub-groups are stored apart from custom properties.
    """
    separate = getattr(group, "bl_system_properties_get", None)
    stored = separate() if separate else group
    return {name: part.to_dict() for name, part in stored.items() if hasattr(part, "to_dict")} if stored else {}


def is_module() -> bool:
    """Return whether Blender runs as a Python module. Before 4.3, only the missing path of a program shows this."""
    return bool(getattr(bpy.app, "module", not bpy.app.binary_path))


def list_library_folders() -> tuple[Path, ...]:
    """List the folders in which this Blender may have its bundled libraries."""
    installed = Path(bpy.utils.resource_path("LOCAL")).parent
    return tuple(installed / name for name in ("lib", "blender.shared"))


def hide_from_rays(item: bpy.types.Object, from_camera: bool = True) -> None:
    """Hide an object from all rays of Cycles, or from all except camera rays. 5.2 adds the rays of the node
    *Raycast*."""
    for kind in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow", "raycast", "camera"):
        if hasattr(item, f"visible_{kind}") and (from_camera or kind != "camera"):
            setattr(item, f"visible_{kind}", False)


def ensure_nodes(data_block: bpy.types.Material | bpy.types.World) -> bpy.types.NodeTree:
    """Return the node tree of a new material or world; it is made here if this Blender does not make it."""
    if data_block.node_tree is None:
        data_block.use_nodes = True
    return data_block.node_tree


def uses_nodes(material: bpy.types.Material) -> bool:
    """Return whether Cycles uses the nodes of a material. From 5.0 on it always does."""
    return bpy.app.version >= (5, 0, 0) or bool(material.use_nodes)


def ensure_light_nodes(light: bpy.types.Light) -> bpy.types.NodeTree:
    """Switch on the node tree of a lamp, and return it."""
    light.use_nodes = True
    return light.node_tree


def use_multilayer_exr(image_settings: bpy.types.ImageFormatSettings) -> None:
    """Choose multilayer OpenEXR. From 5.0 on, the media type must be set first."""
    if hasattr(image_settings, "media_type"):
        image_settings.media_type = "MULTI_LAYER_IMAGE"
    image_settings.file_format = "OPEN_EXR_MULTILAYER"


def disable_light_factors(light: bpy.types.Light) -> None:
    """Switch off exposure and temperature of a lamp, because later versions of Blender multiply its energy by both."""
    if hasattr(light, "exposure"):
        light.exposure = 0.0
    if hasattr(light, "use_temperature"):
        light.use_temperature = False


def set_equidistant_fisheye(lens: bpy.types.Camera, field_rad: float) -> None:
    """Make a lens Cycles' equidistant fisheye with a field of ``field_rad`` radians, for square images. From 5.0 on,
    the lens itself has the properties.

    ``set_fisheye`` is for images of any shape. Its rays are the same within rounding, so noise and edges differ.
    """
    lens.type = "PANO"
    own = _find_panorama_owner(lens)
    own.panorama_type, own.fisheye_fov = "FISHEYE_EQUIDISTANT", field_rad


def draw_linear_texture(texture: gpu.types.GPUTexture, x: float, y: float, width: float, height: float) -> None:
    """Draw a texture of linear light over a 3D View, its lower left corner at (x, y) of the region.

    Before 5.0 the view encodes drawings over it for the screen. Since 5.0 the drawing itself must be encoded.
    """
    from gpu_extras.presets import draw_texture_2d

    options = {"is_scene_linear_with_rec709_srgb_target": True} if bpy.app.version >= (5, 0, 0) else {}
    draw_texture_2d(texture, (x, y), width, height, **options)


def _find_panorama_owner(lens: bpy.types.Camera) -> bpy.types.bpy_struct:
    """Find the owner of a panoramic camera's properties: the camera from 5.0 on, earlier its Cycles properties."""
    return lens if hasattr(lens, "panorama_type") else lens.cycles


def set_panorama(lens: bpy.types.Camera, longitude_rad: float, latitude_rad: float) -> None:
    """Make a camera take equirectangular images, up to these angles in radians on both sides of the middle."""
    lens.type = "PANO"
    panorama = _find_panorama_owner(lens)
    panorama.panorama_type = "EQUIRECTANGULAR"
    panorama.longitude_min, panorama.longitude_max = -longitude_rad, longitude_rad
    panorama.latitude_min, panorama.latitude_max = -latitude_rad, latitude_rad


def set_fisheye(lens: bpy.types.Camera, focal_mm: float) -> None:
    """Make a camera an equidistant fisheye that sees all around, with the focal length ``focal_mm`` on its sensor.

    Blender's own equidistant fisheye has another scale along rows than along columns. Its polynomial fisheye has angles
    of the opposite sign.
    """
    lens.type = "PANO"
    panorama = _find_panorama_owner(lens)
    panorama.panorama_type = "FISHEYE_LENS_POLYNOMIAL"
    panorama.fisheye_fov = 2.0 * math.pi
    panorama.fisheye_polynomial_k1 = -1.0 / focal_mm
    for k in (0, 2, 3, 4):
        setattr(panorama, f"fisheye_polynomial_k{k}", 0.0)


def has_cycles() -> bool:
    """Return whether the add-on of Cycles is enabled."""
    return hasattr(bpy.types.Scene, "cycles")


def has_osl() -> bool:
    """Return whether Cycles was built with Open Shading Language. Without it, script nodes render black."""
    try:
        import _cycles
    except ImportError:
        return False
    return bool(_cycles.with_osl)


def compile_osl(source: Path, target: Path) -> bool:
    """Compile a shader with the compiler in Cycles. Returns whether this succeeded.

    Blender's own Python code needs ``oslquery``, which the wheels from 4.5 on do not contain.
    """
    import _cycles

    return bool(_cycles.osl_compile(str(source), str(target)))


def has_oidn() -> bool:
    """Return whether Cycles was built with OpenImageDenoise. Without it, a denoised render fails."""
    try:
        import _cycles
    except ImportError:
        return False
    return bool(getattr(_cycles, "with_openimagedenoise", False))


def find_mesh_importer(kind: str) -> tuple[Any, dict[str, Any]] | None:
    """Find the operator that reads a kind of mesh file and its options, or None if this Blender has none.

    OBJ, PLY and STL keep their coordinates. The others are rotated as their headers state. Meshes are not validated if
    the importer allows that, since validation would hide their faults.
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
            continue  # FBX is in wm from 5.0 on only, and a build may lack a format
        return operator, {key: value for key, value in options.items() if key in known}
    return None


def applies_usd_unit() -> bool:
    """Return whether the USD importer converts the unit of the file to metres (from 4.5 on)."""
    found = find_mesh_importer("USD")
    return found is not None and "apply_unit_conversion_scale" in found[0].get_rna_type().properties


#: Properties of Normal Map nodes from 5.1 on, with the values that earlier Blenders imply: green is up, and the normal
#: is taken from the mesh before displacement.
NORMAL_MAP_PROPERTIES = {
    name: value
    for name, value in (("convention", "OPENGL"), ("base", "ORIGINAL"))
    if name in bpy.types.ShaderNodeNormalMap.bl_rna.properties
}

#: The add-on that reads a format, for formats that Blender itself does not read.
IMPORT_ADD_ONS = {"glTF": "io_scene_gltf2", "FBX": "io_scene_fbx"}
