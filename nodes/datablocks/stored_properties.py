"""Lists the properties of Blender's structures that a render can show.

Every property that Blender stores counts, unless it is listed here with a reason. So a property that a later Blender
adds counts without a change of this list. A test requires a reason for every property that does not change a
fingerprint.
"""

from __future__ import annotations

from functools import lru_cache

import bpy

#: Properties that do not count, by the reason and by the RNA name of the structure. They hold for derived structures
#: too.
LEFT_OUT: dict[str, dict[str, str]] = {
    "only names or lists it, and nothing refers to it by that": {
        "ID": "name name_full use_fake_user use_extra_user tag asset_data library_weak_reference is_editable "
        "is_runtime_data",
        "Modifier": "name",
        "Constraint": "name",
        "MaterialSlot": "name",
        "Node": "label",
        "ActionSlot": "identifier name_display target_id_type_icon",
        "AnimData": "last_slot_identifier",
        "NlaStrip": "name last_slot_identifier",
        "NlaTrack": "name",
        "Collection": "color_tag",
        "Action": "pose_markers",
        "Bone": "collections",
        "Armature": "collections collections_all",
    },
    "selection in a list or an editor": {
        "Collection": "active_exporter_index exporters",
        "Modifier": "is_active",
        "Constraint": "active",
        "ActionSlot": "select",
        "FCurve": "select",
        "Keyframe": "select_left_handle select_right_handle select_control_point",
        "BezierSplinePoint": "select_left_handle select_right_handle select_control_point",
        "SplinePoint": "select",
        "MetaElement": "select",
        "LatticePoint": "select",
        "CurveMapPoint": "select",
        "NlaTrack": "select",
        "NlaStrip": "select",
        "PoseBone": "select",
        "Bone": "select select_head select_tail",
        "Node": "select",
        "Object": "active_material active_material_index active_shape_key active_shape_key_index active_selection_set "
        "selection_sets",
        "AnimData": "use_pin",
        "NodeTreeInterface": "active active_index",
        "Material": "paint_active_slot paint_clone_slot texture_paint_images texture_paint_slots",
        "NodesModifier": "panels",
        "GeometryNodesModifierInterface": "panels",
        "TextCurve": "active_textbox edit_format",
    },
    "display in editors and in the 3D View": {
        "Object": "hide_viewport hide_select display display_type show_bounds display_bounds_type show_name show_axis "
        "show_texture_space show_wire show_all_edges show_transparent show_in_front empty_display_type "
        "empty_display_size empty_image_offset empty_image_depth empty_image_side use_empty_image_alpha "
        "show_empty_image_perspective show_empty_image_orthographic show_empty_image_only_axis_aligned "
        "hide_surface_pick show_instancer_for_viewport animation_visualization motion_path image_user "
        "use_grease_pencil_lights hide_probe_volume hide_probe_sphere hide_probe_plane",
        "Modifier": "show_viewport show_in_editmode show_on_cage show_expanded use_pin_to_last",
        "Constraint": "show_expanded",
        "ActionSlot": "show_expanded",
        "NodesModifier": "show_group_selector show_manage_panel open_output_attributes_panel open_manage_panel "
        "open_bake_panel open_named_attributes_panel open_bake_data_blocks_panel open_warnings_panel",
        "CurvesModifier": "open_mask_input_panel",
        "Collection": "hide_select hide_viewport",
        "SpotLight": "show_cone",
        "Camera": "passepartout_alpha display_size show_limits show_mist show_passepartout show_safe_areas show_name "
        "show_safe_center show_sensor show_background_images lens_unit composition_guide_color "
        "show_composition_center show_composition_center_diagonal show_composition_thirds "
        "show_composition_golden show_composition_golden_tria_a show_composition_golden_tria_b "
        "show_composition_harmony_tri_a show_composition_harmony_tri_b background_images",
        "Material": "preview_render_type use_preview_world",
        "NodeSocket": "name label description hide hide_value enabled link_limit show_expanded pin_gizmo type "
        "display_shape select inferred_structure_type",
        "NodeLink": "is_valid is_hidden",
        "Node": "location location_absolute width height dimensions color use_custom_color hide show_options "
        "show_preview show_texture parent warning_propagation color_tag",
        "NodeTree": "default_group_node_width view_center description annotation color_tag",
        "NodeTreeInterfaceSocket": "description hide_value hide_in_modifier is_inspect_output is_panel_toggle "
        "menu_expanded optional_label",
        "NodeTreeInterfacePanel": "description default_closed",
        "GeometryNodeTree": "show_modifier_manage_panel use_wait_for_click is_tool is_mode_object is_mode_edit "
        "is_mode_sculpt is_mode_paint is_type_mesh is_type_curve is_type_pointcloud is_modifier "
        "is_type_grease_pencil",
        "FCurve": "color color_mode hide lock group",
        "FModifier": "show_expanded active name",
        "NlaTrack": "lock",
        "ActionChannelbag": "groups",
        "Action": "groups",
        "Keyframe": "type co_ui",
        "PoseBone": "hide color custom_shape custom_shape_scale_xyz custom_shape_translation custom_shape_transform "
        "custom_shape_rotation_euler use_transform_at_custom_shape use_transform_around_custom_shape "
        "use_custom_shape_bone_size custom_shape_wire_width motion_path",
        "Bone": "hide hide_select show_wire color display_type",
        "Armature": "display_type show_axes axes_position relation_line_position show_names show_bone_custom_shapes "
        "show_bone_colors",
        "Pose": "animation_visualization",
        "Volume": "display",
        "MetaBall": "resolution update_method",
        "SplinePoint": "hide",
        "BezierSplinePoint": "hide",
        "Spline": "hide",
    },
    "used only by tools and importers": {
        "Object": "lock_location lock_rotation lock_rotation_w lock_rotations_4d lock_scale use_mesh_mirror_x "
        "use_mesh_mirror_y use_mesh_mirror_z use_camera_lock_parent use_shape_key_edit_mode",
        "PoseBone": "lock_location lock_rotation lock_rotation_w lock_rotations_4d lock_scale",
        "Pose": "use_mirror_x use_mirror_relative use_auto_ik",
        "Armature": "use_mirror_x edit_bones",
        "ShapeKey": "lock_shape",
        "VertexGroup": "lock_weight",
        "TextCurve": "use_fast_edit",
        "Mesh": "remesh_voxel_size remesh_voxel_adaptivity use_remesh_fix_poles use_remesh_preserve_volume "
        "use_remesh_preserve_attributes use_remesh_preserve_vertex_colors use_remesh_preserve_paint_mask "
        "use_remesh_preserve_sculpt_face_sets remesh_mode use_mirror_x use_mirror_y use_mirror_z "
        "use_mirror_vertex_groups radial_symmetry use_mirror_topology use_paint_bone_selection use_paint_mask "
        "use_paint_mask_vertex uv_layer_clone uv_layer_clone_index uv_layer_stencil uv_layer_stencil_index",
        "Curves": "use_mirror_x use_mirror_y use_mirror_z selection_domain use_sculpt_collision "
        "surface_collision_distance",
        "Text": "use_module indentation current_line_index select_end_line_index current_character "
        "select_end_character",
        "Image": "resolution display_aspect use_view_as_render seam_margin",
        "ShaderNodeScript": "use_auto_update",
        "Action": "use_frame_range use_cyclic frame_start frame_end frame_range",
    },
    "used only by EEVEE, Freestyle, line art or simulations, which are not rendered": {
        "Object": "lineart field collision soft_body rigid_body rigid_body_constraint shader_effects",
        "Collection": "lineart_usage lineart_use_intersection_mask lineart_intersection_mask "
        "lineart_intersection_priority use_lineart_intersection_priority",
        "Material": "surface_render_method blend_method shadow_method alpha_threshold use_transparency_overlap "
        "show_transparent_back use_backface_culling use_backface_culling_shadow "
        "use_backface_culling_lightprobe_volume use_raytrace_refraction use_screen_refraction "
        "use_sss_translucency refraction_depth thickness_mode use_thickness_from_shadow line_color "
        "line_priority lineart grease_pencil specular_color specular_intensity max_vertex_displacement",
        "SplinePoint": "weight_softbody",
        "BezierSplinePoint": "weight_softbody",
        "LatticePoint": "weight_softbody",
    },
    "follows from other properties that count, or is read separately": {
        "Object": "matrix_world matrix_local matrix_basis dimensions bound_box mode particle_systems",
        "PoseBone": "matrix matrix_basis matrix_channel parent child bone",
        "Mesh": "vertices edges loops polygons vertex_normals polygon_normals corner_normals loop_triangles "
        "loop_triangle_polygons uv_layers vertex_colors attributes color_attributes texture_mesh auto_texspace",
        "Curves": "curves points position_data curve_offset_data normals attributes color_attributes",
        "PointCloud": "points attributes color_attributes",
        "Camera": "angle angle_x angle_y",
        "Node": "inputs outputs internal_links dimensions",
        "NodeTree": "nodes links",
        "FCurve": "is_valid is_empty",
        "Driver": "is_valid",
        "AnimData": "action_suitable_slots use_tweak_mode action_tweak_storage action_slot_handle_tweak_storage",
        "ActionChannelbag": "slot",
        "NlaStrip": "frame_start_ui frame_end_ui frame_start_raw frame_end_raw action_suitable_slots",
        "Image": "filepath filepath_raw packed_file packed_files pixels render_slots has_data size depth channels "
        "is_dirty is_float frame_duration",
        "Text": "filepath lines current_line select_end_line",
        "Collection": "all_objects objects children collection_objects collection_children",
        "Key": "user",
        "ShapeKey": "points data",
        "NodeTreeInterfaceItem": "parent",
        "VectorFont": "packed_file",
        "Modifier": "execution_time",
        "NodesModifier": "node_warnings bakes bake_directory bake_target",
        "Volume": "grids packed_file",
        "Bone": "children",
        "CacheFile": "object_paths",
        "ColorManagedInputColorspaceSettings": "is_data",
    },
}

#: Properties of a material with nodes that only the 3D View shows.
OF_THE_VIEW = ("diffuse_color", "roughness", "metallic")
#: Read-only properties that Blender stores all the same.
_STORED_READ_ONLY = {
    "ShapeKey": {"frame"},
    "NodeTreeInterfaceItem": {"item_type"},
    "Bone": {"head_local", "tail_local", "matrix_local"},
    "NodeTreeInterfaceSocket": {"identifier", "in_out"},
    "Object": {"type"},
    "ActionSlot": {"handle"},
    "ActionChannelbag": {"slot_handle"},
    "VertexGroupElement": {"group"},
}
#: Pointers to data that counts elsewhere, for which the name is enough.
BY_NAME = {
    ("ShapeKey", "relative_key"),
    ("Key", "reference_key"),
    ("Bone", "parent"),
    ("Bone", "bbone_custom_handle_start"),
    ("Bone", "bbone_custom_handle_end"),
    ("PoseBone", "bbone_custom_handle_start"),
    ("PoseBone", "bbone_custom_handle_end"),
}
_OF_EVERY_BLOCK = {"rna_type", "original", "library", "override_library", "preview", "id_type", "is_embedded_data"}
_PLAIN_TYPES = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}


def _list_kinds(struct: bpy.types.bpy_struct) -> list[str]:
    """List the RNA names of a structure and of its base structures."""
    return [base.bl_rna.identifier for base in struct.__mro__ if hasattr(base, "bl_rna")]


@lru_cache(maxsize=1)
def _list_reasons() -> dict[tuple[str, str], str]:
    return {
        (kind, name): reason
        for reason, kinds in LEFT_OUT.items()
        for kind, names in kinds.items()
        for name in names.split()
    }


def why_left_out(struct: bpy.types.bpy_struct, name: str) -> str | None:
    """Return the reason why a property does not count; None if it counts."""
    found = next((_list_reasons()[kind, name] for kind in _list_kinds(struct) if (kind, name) in _list_reasons()), None)
    if found is None and issubclass(struct, bpy.types.Node) and name.startswith(("bl_", "active_")):
        return "definition of the kind of node, or selection of one of its items"
    return found


@lru_cache(maxsize=1024)
def stored_properties(struct: bpy.types.bpy_struct) -> tuple[tuple[str, str], ...]:
    """List (name, kind) of each property of a structure that counts. ``kind`` is the way to read it: ``value``,
    ``file`` (a path), ``pointer``, ``name`` (a pointer whose name counts) or ``items``."""
    fixed = set().union(*(_STORED_READ_ONLY.get(kind, set()) for kind in _list_kinds(struct)))
    by_name = {name for kind, name in BY_NAME if kind in _list_kinds(struct)}
    found = []
    for prop in struct.bl_rna.properties:
        name = prop.identifier
        if (
            name in _OF_EVERY_BLOCK
            or getattr(prop, "is_deprecated", False)
            or why_left_out(struct, name)
            or _belongs_to_add_on(struct, prop)
        ):
            continue
        if prop.type in _PLAIN_TYPES and (not prop.is_readonly or name in fixed):
            found.append((name, "file" if prop.type == "STRING" and prop.subtype == "FILE_PATH" else "value"))
        elif prop.type == "POINTER":
            found.append((name, "name" if name in by_name else "pointer"))
        elif prop.type == "COLLECTION":
            found.append((name, "items"))
    return tuple(found)


def _belongs_to_add_on(struct: bpy.types.bpy_struct, prop: bpy.types.Property) -> bool:
    """Return whether a property belongs to an add-on, which has no effect on Cycles and is not loaded by workers."""
    # Blender registers some properties of its nodes, and from 5.2 on the inputs of modifiers, as add-ons do.
    by_blender = (
        issubclass(struct, (bpy.types.PropertyGroup, bpy.types.Node))
        or struct.bl_rna.identifier == "GeometryNodesModifierInterface"
    )
    return prop.is_runtime and not by_blender and not prop.identifier.startswith("cycles")
