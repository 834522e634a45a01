"""Materials of snow and ice with the chosen reflectance law, procedural grain and images."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import bpy

from ...physics.random_numbers.seeds import make_generator
from ...physics.rig.focal_length import focal_px
from ...physics.scene_requirements import emits, only_camera_meets_relief
from ...physics.surfaces import principled
from ...physics.surfaces.fractures import has_fractures
from ...physics.surfaces.hapke import hapke_from_settings
from ...settings.table import TOPICS
from ...settings.topics.scene import Settings
from ...settings.topics.surfaces import HapkeSettings, SurfaceSettings
from ...support.blender import compat
from ...support.labels import NORMAL_AOV, ROCK, SALT_AOV, TERRAIN
from ..tree.builder import WHITE, Node, Socket, Tree, Triple, Value
from ..tree.formula import Number
from . import dug_layers, ice_layers, own_groups, reflectance_laws
from .baked_passes import add_baked_passes
from .dirt_and_salt_colour import add_ground_colour, add_salt_share
from .fractures import VEIL_ALBEDO, add_fracture_share
from .glints import add_glints
from .patches_and_grain import (
    ELEVATION,
    GRAIN_FARTHEST,
    add_brightness,
    add_face_variation,
    add_grain,
    add_grain_by_fineness,
    add_patchy_grain,
    find_darkest_factor,
)
from .shown_albedo import add_albedo_pass
from .sun_inputs import Sun
from .textures import Painted, Sampler, Textured

#: Blender's level of the specular reflection of a crust: pores take half of what a sheet of ice would reflect.
_CRUST_SPECULAR = 0.25


def _add_product(tree: Tree, label: str, a: Socket | None, b: Socket | None) -> Socket | None:
    """Multiply two colours, where None is white, and return the output socket; None for white."""
    if a is None or b is None:
        return b if a is None else a
    return tree.vector("MULTIPLY", label, a, b)


def _add_reflectance(tree: Tree, surface: SurfaceSettings, grey: Value, colour: Socket | None) -> Value:
    """Add the reflectance, albedo x grey x colour: a number, or the output socket of a colour."""
    albedo = surface.albedo
    if isinstance(grey, float) and colour is None:
        return albedo * grey
    grey = albedo * grey if isinstance(grey, float) else tree.math("MULTIPLY", "Reflectance", grey, albedo)
    if colour is None:
        return tree.colour("Grey", grey, grey, grey)
    return tree.scaled("Coloured", colour, grey)


def _add_fine_height(
    tree: Tree,
    surface: SurfaceSettings,
    where: Socket,
    place: Sequence[float],
    pieces: Sampler | None,
    textured: Textured | None,
) -> Socket | None:
    """Add the height in metres of grain and height image, with a mean of 0. Return its output socket; None if there is
    neither."""
    grain = None
    if surface.grain_amplitude_m > 0.0:
        about_0 = add_grain(tree, where, surface.grain_size_m, place)
        even = tree.math("MULTIPLY", "Grain Height", about_0, surface.grain_amplitude_m)
        grain = add_patchy_grain(tree, surface, where, place, even)
    return _add_sum(tree, grain, _add_image_height(tree, pieces, textured))


def _add_image_height(tree: Tree, pieces: Sampler | None, textured: Textured | None) -> Socket | None:
    """Add the height in metres of the height image, with a mean of 0. Return its output socket; None without a height
    image."""
    if pieces is None or textured is None or "height" not in textured.maps:
        return None
    of = textured.maps["height"]
    sampled = tree.separated("Map Height", pieces.sample("height", of))[0]
    centred = tree.math("SUBTRACT", "Map About 0", sampled, of.mean[0])
    return tree.math("MULTIPLY", "Map Height in Metres", centred, textured.settings.height_m)


def _add_sum(tree: Tree, a: Socket | None, b: Socket | None) -> Socket | None:
    """Add two heights (None is 0) and return the output socket of the sum."""
    if a is None or b is None:
        return b if a is None else a
    return tree.math("ADD", "Fine Height", a, b)


def _add_snow(
    tree: Tree, label: str, surface: SurfaceSettings, wanted: Value, varied: Mapping[str, Any], normal: Socket | None
) -> Socket:
    """Add a Principled surface with the reflectance ``wanted``, a number or a socket, and return its shader socket.

    ``varied`` has sockets for some of its inputs, ``normal`` is a socket or None.
    """
    radius = surface.subsurface_radius_m
    if isinstance(wanted, (int, float)):
        base: Triple = (*[principled.base_colour(surface, wanted)] * 3, 1.0)
    else:
        base = tree.curve(f"Base of {label}", wanted, *principled.base_colour_curve(surface))
    return tree.principled(
        label,
        base,
        varied.get("roughness", surface.roughness),
        surface.subsurface_method,
        **{
            "IOR": surface.refractive_index,
            "Subsurface Weight": surface.subsurface_weight if radius > 0.0 else 0.0,
            "Subsurface Scale": radius,
            "Specular IOR Level": surface.specular,
            "Transmission Weight": varied.get("transmission", surface.transmission),
            "Normal": normal,
        },
    )


def _add_principled(
    tree: Tree,
    label: str,
    surface: SurfaceSettings,
    wanted: Value,
    varied: Mapping[str, Any],
    normal: Socket | None,
    smooth: bool,
) -> Socket:
    """Add Principled ice, and return its shader socket. If ``smooth``, only camera rays see its relief."""
    seen = _add_snow(tree, label, surface, wanted, varied, normal)
    if not smooth or normal is None:
        return seen
    bare = surface | {"grain_amplitude_m": 0.0}  # its albedo needs no correction for light lost between bumps
    return reflectance_laws.mix_by_camera_ray(
        tree, seen, _add_snow(tree, f"Smooth {label}", bare, wanted, varied, None)
    )


@dataclass(frozen=True)
class _PatternOffsets:
    """Random offsets of the patterns, drawn from a seed. Patterns in three dimensions have three offsets."""

    patches: float
    grain: Sequence[float]
    salt: float
    image: tuple[float, float]
    bands: float
    frost: float
    crust: float
    fractures: float

    @classmethod
    def draw(cls, seed: int) -> _PatternOffsets:
        """Draw the offsets of a seed."""
        drawn = map(float, make_generator(seed, "surface").uniform(0.0, 1000.0, 11))
        patches, grain_x, salt, east, north, grain_y, grain_z, bands, frost, crust, fractures = drawn
        grain = [along % GRAIN_FARTHEST for along in (grain_x, grain_y, grain_z)]
        return cls(patches, grain, salt, (east, north), bands, frost, crust, fractures)

    @property
    def glints(self) -> float:
        """Offset of the glints: a multiple of 64, so that different offsets differ by more than the number of
        octaves."""
        return math.floor(self.salt) * 64.0


@dataclass(frozen=True)
class _Ice:
    """Arguments that the layers of Principled ice share: for ``_add_principled``, and for glints."""

    tree: Tree
    surface: SurfaceSettings
    wanted: Value
    varied: Mapping[str, Any]
    normal: Socket | None
    smooth: bool
    geometry: Node
    pixel_rad: float
    at: _PatternOffsets
    frost_mask: Value = 1.0
    marked: bool = False  # whether the mesh may have the attributes of the ground

    def add(self, label: str, surface: SurfaceSettings, glints: bool = False) -> Socket:
        """Add ice with ``surface`` settings, except for their albedo, and return its shader socket."""
        shader = _add_principled(self.tree, label, surface, self.wanted, self.varied, self.normal, self.smooth)
        if not glints or surface.glint_share == 0.0 or self.pixel_rad == 0.0:
            return shader
        normal = self.geometry.outputs["Normal"] if self.normal is None else self.normal
        return add_glints(
            self.tree,
            shader,
            self.wanted,
            self.geometry,
            normal,
            surface.glint_share,
            surface.glint_size_m,
            self.pixel_rad,
            self.at.glints,
        )


def _add_layers(ice: _Ice, crusted: Socket | None, of_rocks: bool) -> tuple[Any, Any]:
    """Add Principled ice with the layers of its settings. Return the sockets of its shader, and of its volume or
    None."""
    tree, surface, volume = ice.tree, ice.surface, None
    through = of_rocks and principled.lets_light_through(surface)
    if through:
        ice = replace(ice, varied={key: value for key, value in ice.varied.items() if key != "transmission"})
        surface = surface | {"transmission": 0.0}
    shader = ice.add("Snow", surface, glints=surface.frost_share == 0.0)
    if through:
        clear, volume = ice_layers.add_clear_ice(tree, surface, ice.normal)
        shader = tree.over("Clear Share", ice.surface.transmission, shader, clear)
    if has_fractures(ice.surface):
        veil = surface | {"roughness": 1.0, "specular": 0.0, "transmission": 0.0, "subsurface_weight": 0.0}
        veiled = add_fracture_share(tree, ice.surface, ice.geometry, ice.at.fractures, of_rocks)
        shader = tree.over(
            "Fractures Within", veiled, shader, replace(ice, wanted=VEIL_ALBEDO, varied={}).add("Veil", veil)
        )
    if crusted is not None:
        crust = surface | {
            "roughness": surface.crust_roughness,
            "specular": _CRUST_SPECULAR,
            "grain_amplitude_m": surface.grain_amplitude_m * ice_layers.CRUST_GRAIN,
        }
        shader = tree.over("Crust on Snow", crusted, shader, ice.add("Crust", crust))
    if surface.frost_share > 0.0:
        frost = surface | {"roughness": 1.0, "specular": 0.0, "transmission": 0.0, "subsurface_weight": 0.0}
        frosted = ice_layers.add_frost_share(tree, surface, ice.geometry, ice.at.frost, ice.frost_mask, ice.marked)
        over = replace(ice, wanted=surface.frost_albedo, varied={}).add("Frost", frost, glints=True)
        shader = tree.over("Frost on Ice", frosted, shader, over)
    return shader, volume


def _list_varying_images(
    surface: SurfaceSettings, settings: Settings | None, textured: Textured | None
) -> tuple[str, ...]:
    """List the kinds of images that vary inputs of the surface's reflectance law."""
    if surface.model == "PRINCIPLED":
        return "roughness", "transmission"
    varies = settings is not None and surface.model == "HAPKE" and settings.hapke.theta_bar_range_deg != 0.0
    return ("roughness",) if varies and textured is not None and textured.placement != "MEAN" else ()


def _add_slopes(tree: Tree, hapke: HapkeSettings, image: bpy.types.Image, mean: float) -> reflectance_laws.Slopes:
    """Add Hapke's θ̄ as varied by the values of a roughness image with the given ``mean``."""
    middle, span = math.radians(hapke.theta_bar_deg), math.radians(hapke.theta_bar_range_deg)
    most = math.radians(TOPICS["hapke"]["theta_bar_deg"].maximum)
    low, high = (min(max(middle + span * (end - mean), 0.0), most) for end in ((0.0, 1.0) if span > 0 else (1.0, 0.0)))
    slope = Number(tree, image).times_plus(span, middle - span * mean).at_least(low).at_most(high)
    return reflectance_laws.Slopes(slope.named("θ̄").value, low, high)


def _add_law(
    material: bpy.types.Material,
    surface: SurfaceSettings,
    settings: Settings | None,
    ground: reflectance_laws.Ground,
    smooth: bool,
    least: float,
) -> dict[str, Any]:
    """Add a law other than Principled, and return its shader sockets by the renderer that they are for.

    ``least`` is the least factor on the albedo.
    """
    if surface.model == "LAMBERT":
        return {"ALL": reflectance_laws.add_lambert(ground, surface.albedo, smooth)}
    if settings is None:
        raise ValueError(f"{surface.model} depends on the direction of the Sun; pass the settings of the scene.")
    sun = Sun.from_settings(settings.light)
    if surface.model not in ("HAPKE", "SNOW"):
        share = 1.0 if surface.model == "LOMMEL_SEELIGER" else surface.lommel_seeliger_share
        return {"ALL": reflectance_laws.add_lunar_lambert(ground, surface.albedo, share, sun)}
    snow = surface.model == "SNOW"
    if snow and settings.hapke.backend != "OSL":
        return {"ALL": reflectance_laws.add_snow(ground, surface.albedo, sun)}
    use_osl, level, _ = reflectance_laws.choose_backend(settings.hapke, settings.quality.device)
    grains = reflectance_laws.Grains(hapke_from_settings(settings.hapke), least)
    # The emission of a surface that traces the Sun is not a light source, and the law handles grazing bumps itself.
    material.cycles.emission_sampling = "NONE"
    material.cycles.use_bump_map_correction = False
    if snow:
        return {
            "CYCLES": reflectance_laws.add_snow_of_osl(ground, surface.albedo, sun, level),
            "EEVEE": reflectance_laws.add_snow(ground, surface.albedo, sun),
        }
    if not use_osl:
        return {"ALL": reflectance_laws.add_hapke_of_nodes(ground, grains, sun)}
    return {
        "CYCLES": reflectance_laws.add_hapke_of_osl(ground, grains, sun, level),
        "EEVEE": reflectance_laws.add_hapke_of_nodes(ground, grains, sun),
    }


class _Material:
    """A material under construction. Its methods are called in their order, since each adds nodes that later ones
    use."""

    def __init__(
        self,
        material: bpy.types.Material,
        tree: Tree,
        surface: SurfaceSettings,
        seed: int,
        semantic: int,
        textured: Textured | None,
        settings: Settings | None,
        painted: Painted | None,
    ) -> None:
        self.material, self.tree = material, tree
        self._settings, self._textured = settings, textured
        self._of_rocks, self._of_terrain = semantic == ROCK, semantic == TERRAIN
        self._at = _PatternOffsets.draw(seed)
        self._geometry = self.tree.node("ShaderNodeNewGeometry", "Geometry")
        self._surface = ice_layers.apply_bubble_albedo(surface)
        self._maps = textured.maps if textured is not None else {}
        self._pieces = (
            textured.make_sampler(self.tree, self._geometry, self._at.image)
            if textured is not None and self._maps
            else None
        )
        self._painted = painted.make_sampler(self.tree, self._geometry) if painted is not None else None
        self._varied: dict[str, Any] = {}  # sockets of the law's inputs that vary over the ground, by their names
        self._normal: Socket | None = None  # the socket of the normal with relief, if there is relief
        self._displacement: Socket | None = None  # the socket of moved vertices, if vertices are moved
        self._crusted: Socket | None = None
        self._volume: Socket | None = None

    @property
    def _is_principled(self) -> bool:
        return self._surface.model == "PRINCIPLED"

    @cached_property
    def _dirt_mask(self) -> Value:
        return self._painted.sample_share("dirt") if self._painted is not None else 1.0

    @cached_property
    def _frost_mask(self) -> Value:
        return self._painted.sample_share("frost") if self._painted is not None else 1.0

    def vary_inputs(self) -> None:
        """Let images vary the inputs of the reflectance law."""
        for kind in _list_varying_images(self._surface, self._settings, self._textured):
            if self._pieces is not None and kind in self._maps:
                of = self._maps[kind]
                self._surface = self._surface | {kind: of.mean[of.channel]}
                sampled = self._pieces.sample(kind, of)
                self._varied[kind] = self.tree.separated(kind.title(), sampled)[of.channel]

    def add_brightness(self, dug: bool) -> None:
        """Multiply the albedo by the factors of patches, of ground that was dug open, of the user's own node group, and
        of the faces of rocks."""
        tree, surface = self.tree, self._surface
        self._grey = add_brightness(tree, surface, self._geometry, self._at.patches, self._of_terrain, self._dirt_mask)
        self._least = find_darkest_factor(surface)
        if dug and self._settings is not None and dug_layers.is_shown(self._settings.excavation):
            opened = dug_layers.add_dug_brightness(tree, self._settings.excavation)
            self._grey = tree.math("MULTIPLY", "Brightness of Dug Ground", opened, self._grey)
            self._least *= dug_layers.find_darkest_layer(self._settings.excavation)
        if surface.albedo_group:
            own = own_groups.add_own_factor(tree, surface.albedo_group, self._geometry)
            self._grey = tree.math("MULTIPLY", "Brightness by Own Group", own, self._grey)
            self._least *= own_groups.MIN_FACTOR
        if self._of_rocks and surface.face_variation > 0.0:
            kept, rougher = add_face_variation(tree, surface)
            self._grey = tree.math("MULTIPLY", "Brightness of Faces", self._grey, kept)
            if "roughness" in _list_varying_images(surface, self._settings, None):
                roughness = Number(tree, self._varied.get("roughness", surface.roughness)) + Number(tree, rougher)
                self._varied["roughness"] = roughness.at_least(0.0).at_most(1.0).value

    def add_colour(self) -> None:
        """Colour the ice by its bubbles, grains, dirt and salts, and by the albedo image."""
        tree, surface = self.tree, self._surface
        self._bubbly = (
            ice_layers.add_bubbly_colour(tree, surface, self._geometry, self._at.bands, self._of_rocks)
            if self._is_principled and surface.bubble_share > 0.0
            else None
        )
        self._colour = add_ground_colour(
            tree,
            surface,
            self._geometry,
            self._at.salt,
            self._of_terrain,
            self._settings,
            self._bubbly,
            self._dirt_mask,
        )
        if self._pieces is not None and "albedo" in self._maps:
            image = self._maps["albedo"]
            sampled = self._pieces.sample("albedo", image)
            of_mean = tree.scaled("Albedo over Mean", sampled, 1 / max(sum(image.mean) / 3, 1e-6))
            self._colour = _add_product(tree, "Stained Map", of_mean, self._colour)

    def add_relief(self, by_fineness: bool) -> None:
        """Add grain, the crust and the images of height and normals, as bumps or by moving vertices."""
        tree = self.tree
        moved, height = self._add_heights(by_fineness)
        if self._is_principled and self._surface.crust_share > 0.0:
            self._crusted = ice_layers.add_crust_share(tree, self._surface, self._geometry, self._at.crust)
            height = _add_sum(
                tree,
                ice_layers.smooth_under_crust(tree, self._crusted, height),
                ice_layers.add_crust_height(tree, self._surface, self._crusted),
            )
            moved = ice_layers.smooth_under_crust(tree, self._crusted, moved)
        if self._pieces is not None and "normal" in self._maps:
            self._normal = self._pieces.sample_normal(self._maps["normal"])
        if height is not None:
            self._normal = tree.bump("Relief", height, 1.0, self._normal)
        self.material.displacement_method = "BUMP" if moved is None else "DISPLACEMENT"
        if moved is not None:
            self._displacement = tree.node(
                "ShaderNodeDisplacement",
                "Moved",
                {"Height": moved, "Midlevel": 0.0, "Scale": 1.0, "Normal": None},
                space="OBJECT",
            ).outputs[0]

    def _add_heights(self, by_fineness: bool) -> tuple[Any, Any]:
        """Add the heights in metres that move vertices and that bend normals, and return their sockets; None for a
        height that is absent."""
        where, surface = self._geometry.outputs["Position"], self._surface
        if surface.relief == "REAL" and by_fineness and surface.grain_amplitude_m > 0.0:
            moved, painted = add_grain_by_fineness(self.tree, surface, where, self._at.grain)
            return moved, _add_sum(self.tree, painted, _add_image_height(self.tree, self._pieces, self._textured))
        height = _add_fine_height(self.tree, surface, where, self._at.grain, self._pieces, self._textured)
        return (height, None) if surface.relief == "DISPLACEMENT" else (None, height)

    def add_surface(self) -> None:
        """Add the reflectance law and connect it to the outputs of the renderers."""
        shaders = {"ALL": self._add_layers()} if self._is_principled else self._add_law()
        if emits(self._surface) and (self._of_terrain or self._surface.emitted_from == "EVERYWHERE"):
            shaders = {target: self._add_emission(shader) for target, shader in shaders.items()}
        for target, shader in shaders.items():
            label = "Surface in EEVEE" if target == "EEVEE" else "Surface"
            self.tree.surface(shader, label, target, Displacement=self._displacement, Volume=self._volume)

    def _add_emission(self, shader: Socket) -> Socket:
        """Let a surface give light too, and return its shader socket. Rays find this light, and no lamp is looked for
        on the ground."""
        self.material.cycles.emission_sampling = "NONE"
        light = self.tree.emission("Emitted Light", WHITE, self._find_emitted())
        both = {"Shader": shader, "Shader_001": light}
        return self.tree.node("ShaderNodeAddShader", "Reflected and Emitted", both).outputs[0]

    def _find_emitted(self) -> Value:
        """Return the emitted radiance: a number, or an output socket if only hollows emit light."""
        everywhere = float(self._surface.emitted_w_m2_sr)
        if self._surface.emitted_from == "EVERYWHERE":
            return everywhere
        height = self.tree.attribute("Elevation of Hollows", ELEVATION)
        low = self.tree.math("LESS_THAN", "In a Hollow", height, float(self._surface.emitted_below))
        return self.tree.math("MULTIPLY", "Emitted in Hollows", low, everywhere)

    def _add_layers(self) -> Socket:
        settings = self._settings
        # The colour of bubbly ice is its reflectance itself.
        plain = self._surface if self._bubbly is None else self._surface | {"albedo": 1.0}
        ice = _Ice(
            self.tree,
            self._surface,
            _add_reflectance(self.tree, plain, self._grey, self._colour),
            self._varied,
            self._normal,
            self._meets_camera_only,
            self._geometry,
            1.0 / focal_px(settings.rig) if settings is not None else 0.0,
            self._at,
            self._frost_mask,
            self._of_terrain,
        )
        shader, self._volume = _add_layers(ice, self._crusted, self._of_rocks)
        return shader

    def _add_law(self) -> dict[str, Any]:
        slopes = (
            _add_slopes(self.tree, self._settings.hapke, self._varied["roughness"], self._surface.roughness)
            if self._settings is not None and "roughness" in self._varied
            else None
        )
        ground = reflectance_laws.Ground(self.tree, self._normal, self._grey, self._colour, slopes)
        return _add_law(self.material, self._surface, self._settings, ground, self._meets_camera_only, self._least)

    @property
    def _meets_camera_only(self) -> bool:
        """Whether only rays of the camera meet the relief."""
        return self._settings is not None and only_camera_meets_relief(self._surface, self._settings.quality)

    def add_passes(self, albedo_pass: bool) -> None:
        """Add the outputs of the passes: the geometric normal, baked light and, if asked for, the albedo and the
        salt."""
        tree, surface, settings = self.tree, self._surface, self._settings
        tree.value_pass("Geometric Normal", NORMAL_AOV, self._geometry.outputs["True Normal"])
        if albedo_pass:
            by_grains = surface.model == "HAPKE"
            reflectance = _add_reflectance(
                tree,
                surface | {"albedo": 1.0} if by_grains or self._bubbly is not None else surface,
                1.0 if by_grains else self._grey,
                self._colour,
            )
            frosted = (
                ice_layers.add_frost_share(
                    tree, surface, self._geometry, self._at.frost, self._frost_mask, self._of_terrain
                )
                if self._is_principled and surface.frost_share > 0.0
                else None
            )
            add_albedo_pass(tree, surface, settings, self._grey, reflectance, self._least, frosted)
            salt = add_salt_share(
                tree, surface, self._geometry, self._at.salt, self._of_terrain, frosted, self._dirt_mask
            )
            tree.value_pass("Salt", SALT_AOV, value=salt)
        if settings is not None and settings.quality.indirect != "TRACED" and surface.model == "LAMBERT":
            add_baked_passes(tree, _add_reflectance(tree, surface, self._grey, self._colour), self._of_rocks)


def build_material(
    name: str,
    surface: SurfaceSettings,
    seed: int,
    semantic: int,
    textured: Textured | None = None,
    settings: Settings | None = None,
    by_fineness: bool = False,
    albedo_pass: bool = False,
    dug: bool = False,
    painted: Painted | None = None,
) -> bpy.types.Material:
    """Build a material from ``surface`` settings whose reflectance in a white furnace is its albedo.

    Laws that depend on the Sun need the ``settings`` of the whole scene. ``semantic`` is the label in the
    material-index pass. ``dug`` is whether the mesh has the attributes of an excavation. ``painted`` are masks of dirt
    and frost.

    Fine relief is bump, so that the true depth is the depth of the mesh, or it displaces the vertices. Relief of the
    kind REAL is both if ``by_fineness``, when the mesh has the attribute ``SPACING``; otherwise it is bump.

    The geometric normal goes to the value pass ``NORMAL_AOV``, because Cycles' own Normal pass contains the bump. With
    ``albedo_pass`` the albedo goes to ``ALBEDO_AOV``, and the share of salt to ``SALT_AOV``.
    """
    material = bpy.data.materials.new(name)
    material.pass_index = semantic
    tree = Tree(compat.ensure_nodes(material))
    fill_material(material, tree, surface, seed, semantic, textured, settings, by_fineness, albedo_pass, dug, painted)
    return material


def fill_material(
    material: bpy.types.Material,
    tree: Tree,
    surface: SurfaceSettings,
    seed: int,
    semantic: int,
    textured: Textured | None,
    settings: Settings | None,
    by_fineness: bool,
    albedo_pass: bool,
    dug: bool,
    painted: Painted | None,
) -> None:
    """Fill the tree of a material as ``build_material`` does."""
    made = _Material(material, tree, surface, seed, semantic, textured, settings, painted)
    made.vary_inputs()
    made.add_brightness(dug)
    made.add_colour()
    made.add_relief(by_fineness)
    made.add_surface()
    made.add_passes(albedo_pass)
    made.tree.arrange()
