"""The materials of ground and rocks, from the settings of the whole scene."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from ...formats import mesh_images
from ...formats.map_frame import map_frame_from_json
from ...formats.map_site import read_site_place
from ...formats.mesh_images import MeshImage
from ...paper_stand_ins.cached_files import find_texture_files
from ...paper_stand_ins.shown_items import describe_item, list_items
from ...physics.light.ground_colours import clean_albedo
from ...physics.scene_requirements import simplify_surface, surface_topics
from ...physics.surfaces import principled
from ...physics.surfaces.textures import uses_uv
from ...settings.topics.scene import Settings
from ...settings.topics.stand_ins import find_texture_item
from ...settings.topics.surfaces import SurfaceSettings
from ...settings.user_files import has_surroundings
from ...support.errors import IcyMoonError
from ...support.labels import ROCK, TERRAIN, UV_LAYER
from ...support.number_text import show_rounded
from ..datablocks.blend_file_paths import find_used_files
from ..datablocks.fingerprint import NAME, TAG
from ..ground.dug_ground import DEPTH
from ..ground.rocks import LABEL_NODES, add_instance_label_pass
from ..ground.terrain_mesh import SPACING
from ..ground.user_ground import find_ground_file, is_mesh
from ..tree.builder import Tree
from ..tree.followed_tree import FollowedTree, OtherTreeError
from .ice_material import build_material, fill_material
from .images import Map, load_maps, load_mask_image, load_placed_map, measure_brightness_percentiles, measure_means
from .textures import Painted, Textured

#: Share of an image that may reflect more light than it receives without a warning, since single pixels are noise.
_TOO_BRIGHT = 0.005


def advise_on_surfaces(settings: Settings) -> list[str]:
    """Return sentences of advice on the surfaces in the scene; empty without a problem."""
    topics = surface_topics(settings)
    shown = [simplify_surface(settings, topic) for topic in topics]
    # The albedo of rocks that let light through is the albedo of their opaque part; bubbles have their own.
    opaque = [
        surface | ({"transmission": 0.0} if topic == "rock_surface" and principled.lets_light_through(surface) else {})
        for topic, surface in zip(topics, shown, strict=True)
    ]
    sentences = [
        principled.advise_on_albedo(surface)
        for surface in opaque
        if surface.model == "PRINCIPLED" and surface.bubble_share == 0.0
    ]
    textures = settings.textures
    if (
        settings.hapke.theta_bar_range_deg != 0.0
        and any(surface.model == "HAPKE" for surface in shown)
        and (
            textures.set == "NONE"
            or (textures.set == "OWN" and not textures.roughness_file)
            or (textures.set == "STAND_IN" and "roughness" not in find_texture_item(textures.stand_in).kinds)
        )
    ):
        sentences.append("hapke.theta_bar_range_deg has no effect, because the textures have no roughness image.")
    return [*(sentence for sentence in sentences if sentence), *map(describe_item, list_items(settings))]


def refuse_without_uv(settings: Settings, has_uv: bool) -> None:
    """Raise IcyMoonError if images are mapped by UV coordinates, but the ground has none."""
    textures, kind = settings.textures, settings.source.kind
    if not uses_uv(textures) or (has_uv and is_mesh(settings)):
        return
    which, fix = (
        ("textures.set is MESH", "choose another textures.set")
        if textures.set == "MESH"
        else ("textures.mapping is UV", "set textures.mapping to OBJECT")
    )
    if is_mesh(settings):
        raise IcyMoonError(
            f"{find_ground_file(settings)}: has no UV coordinates that show an image, but "
            f"{which}; export it with them, or {fix}."
        )
    ground = "a height map" if kind == "HEIGHT_MAP" else "procedural ground"
    raise IcyMoonError(
        f"{which}, but {ground} has no UV coordinates; {fix}, or choose a mesh that has them (source.kind)."
    )


def _find_image_files(settings: Settings) -> dict[str, Path | MeshImage]:
    """Find the images that the settings or the mesh name, by kind. Raises IcyMoonError if the mesh has none."""
    used = find_used_files(settings)
    if settings.textures.set == "STAND_IN":
        return dict(find_texture_files(settings.textures.stand_in))
    if settings.textures.set != "MESH":
        return {
            name.removeprefix("textures.").removesuffix("_file"): path
            for name, path in used.items()
            if name.startswith("textures.")
        }
    path = find_ground_file(settings)
    found = mesh_images.choose_images(path)
    if not found:
        reason = (
            f"Icy Moon finds images only in {', '.join(mesh_images.MESH_SUFFIXES)} files"
            if path.suffix.lower() not in mesh_images.MESH_SUFFIXES
            else "its materials name no image that exists"
        )
        raise IcyMoonError(
            f"{path}: has no images, because {reason}; set textures.set to OWN and name them, such as "
            "textures.albedo_file."
        )
    return dict(found)


def _load_textures(settings: Settings, mesh: bpy.types.Mesh) -> Textured | None:
    """Load the textures of a ground's mesh; None without textures."""
    textures = settings.textures
    if textures.set == "NONE":
        return None
    if textures.mapping == "MAP" and not uses_uv(textures):
        albedo, placed, _ = _load_placed_albedo(settings)
        return Textured(textures, {"albedo": albedo}, "MAP", placed=placed)
    if not uses_uv(textures):
        placement = "PATCH" if textures.mapping == "PATCH" else "POSITION"
        return Textured(textures, load_maps(textures, _find_image_files(settings)), placement, settings.terrain.size_m)
    if mesh.is_editmode:  # in Edit Mode the mesh has no UV coordinates
        raise IcyMoonError("The ground is being edited; leave Edit Mode to see changes of surfaces with images by UV.")
    refuse_without_uv(settings, UV_LAYER in mesh.attributes)
    return Textured(textures, measure_means(mesh, load_maps(textures, _find_image_files(settings))), "UV")


def _load_placed_albedo(settings: Settings) -> tuple[Map, tuple[float, float, float, float], list[str]]:
    """Load the albedo image that lies by its map coordinates. Returns its map, its edges as in ``Textured.placed``, and
    sentences on the ground that it lacks. Raises IcyMoonError if the ground is on no map, or the image is on none."""
    textures, source = settings.textures, settings.source
    others = [kind for kind in ("roughness", "normal", "transmission", "height") if textures[f"{kind}_file"]]
    if textures.set != "OWN" or not textures.albedo_file or others:
        which = f"; leave textures.{others[0]}_file out." if others else " of textures.set OWN, textures.albedo_file."
        raise IcyMoonError(f"textures.mapping is MAP, which places the albedo image alone{which}")
    frame = None
    if source.kind == "HEIGHT_MAP" and not source.metres_per_pixel > 0:
        place = read_site_place(find_ground_file(settings), settings)
        frame = map_frame_from_json({"map": place.to_json() | {"height_zero_m": 0.0}}) if place else None
    if frame is None:
        raise IcyMoonError(
            "textures.mapping is MAP, but the ground is on no map; give a GeoTIFF with a coordinate system as "
            "source.file, with source.kind HEIGHT_MAP and source.metres_per_pixel 0, or set textures.mapping to PATCH."
        )
    seen_m = 2.0 * float(source.surroundings_m) if has_surroundings(settings) else 0.0
    path = find_used_files(settings)["textures.albedo_file"]
    return load_placed_map(path, frame, float(settings.terrain.size_m), seen_m)


def advise_on_images(settings: Settings, mesh: bpy.types.Mesh) -> list[str]:
    """Return sentences on the albedo image: on ground that it lacks, and on ground of this mesh that reflects more
    light than it receives."""
    textured = _load_textures(settings, mesh)
    if textured is None or "albedo" not in textured.maps:
        return []
    of = textured.maps["albedo"]
    lacking = _load_placed_albedo(settings)[2] if textured.placement == "MAP" else []
    values, mean = measure_brightness_percentiles(of), max(sum(of.mean) / 3, 1e-6)
    reflected = values / mean * clean_albedo(simplify_surface(settings, "surface"), settings.hapke)
    share = 1.0 - float(np.interp(1.0, reflected, np.linspace(0.0, 1.0, len(values)), right=1.0))
    if share < _TOO_BRIGHT:
        return lacking
    return [
        *lacking,
        f"{show_rounded(100 * share)} % of the albedo image reflect more light than they receive, up to "
        f"{show_rounded(reflected[-1])} times as much, because the albedo of the surface is the mean of the image; "
        f"lower the albedo to at most {show_rounded(mean / values[-1])}, or choose an image with less contrast.",
    ]


def _load_rock_textures(settings: Settings, mesh: bpy.types.Mesh) -> Textured | None:
    """Load the textures of rocks; None without textures.

    Rocks have no UV coordinates. If images are mapped by UV and rocks have the surface of the ground, rocks get the
    means of the images over the ground.
    """
    textured = _load_textures(settings, mesh)
    if textured is None or textured.placement != "UV":
        return textured
    if settings.rocks.own_surface:
        return None
    return Textured(
        textured.settings, {kind: of for kind, of in textured.maps.items() if kind not in ("normal", "height")}, "MEAN"
    )


def _load_painted(settings: Settings, topic: str) -> Painted | None:
    """Load the painted masks of a surface that have an effect; None without any."""
    used = find_used_files(settings)
    names = {kind: f"{topic}.{kind}_mask_file" for kind in ("dirt", "frost")}
    masks = {kind: load_mask_image(used[name]) for kind, name in names.items() if name in used}
    return Painted(masks, float(settings.terrain.size_m)) if masks else None


class _MaterialArguments(NamedTuple):
    """The arguments of ``ice_material.fill_material`` after the tree."""

    surface: SurfaceSettings
    seed: int
    semantic: int
    textured: Textured | None
    settings: Settings
    by_fineness: bool
    albedo_pass: bool
    dug: bool
    painted: Painted | None


def _describe_ground(settings: Settings, mesh: bpy.types.Mesh, albedo_pass: bool = False) -> _MaterialArguments:
    """Return the arguments from which ``build_ground_material`` makes the material."""
    return _MaterialArguments(
        simplify_surface(settings, "surface"),
        int(settings.dataset.seed),
        TERRAIN,
        _load_textures(settings, mesh),
        settings,
        SPACING in mesh.attributes,
        albedo_pass,
        DEPTH in mesh.attributes,
        _load_painted(settings, "surface"),
    )


def _describe_rock(settings: Settings, mesh: bpy.types.Mesh, albedo_pass: bool = False) -> _MaterialArguments:
    """Return the arguments from which ``build_rock_material`` makes the material."""
    topic, textured = "rock_surface" if settings.rocks.own_surface else "surface", _load_rock_textures(settings, mesh)
    surface, painted = simplify_surface(settings, topic), _load_painted(settings, topic)
    return _MaterialArguments(
        surface, int(settings.dataset.seed), ROCK, textured, settings, False, albedo_pass, False, painted
    )


def _build_named_material(name: str, arguments: _MaterialArguments) -> bpy.types.Material:
    material = build_material(f"{NAME} {name}", *arguments)
    material[TAG] = "material"
    return material


def build_ground_material(settings: Settings, mesh: bpy.types.Mesh, albedo_pass: bool = False) -> bpy.types.Material:
    """Build the material of the ground with this mesh, see ``build_material``. Raises IcyMoonError if a texture is not
    available."""
    return _build_named_material("Surface", _describe_ground(settings, mesh, albedo_pass))


def build_rock_material(settings: Settings, mesh: bpy.types.Mesh, albedo_pass: bool = False) -> bpy.types.Material:
    """Build the material of rocks on the ground with this mesh, see ``build_material``. Raises IcyMoonError if a
    texture is not available."""
    ice = _build_named_material("Rock Surface", _describe_rock(settings, mesh, albedo_pass))
    add_instance_label_pass(Tree(ice.node_tree, keep=True))
    return ice


def follow_ground_material(material: bpy.types.Material, settings: Settings, mesh: bpy.types.Mesh) -> bool:
    """Give the unedited material of the ground the values for other settings; False if it needs other nodes, and then
    it must be built anew. Raises IcyMoonError, before any change, if a texture is not available."""
    arguments = _describe_ground(settings, mesh)
    try:
        fill_material(material, FollowedTree(material.node_tree), *arguments)
    except OtherTreeError:
        return False
    return True


def follow_rock_material(material: bpy.types.Material, settings: Settings, mesh: bpy.types.Mesh) -> bool:
    """Give the unedited material of rocks the values for other settings, as ``follow_ground_material`` does."""
    arguments = _describe_rock(settings, mesh)
    try:
        fill_material(material, FollowedTree(material.node_tree, without=LABEL_NODES), *arguments)
        add_instance_label_pass(FollowedTree(material.node_tree, only=LABEL_NODES))
    except OtherTreeError:
        return False
    return True
