"""Images on the ground: by UV coordinates, or by position without visible repeats.

By position, the plane is divided into hexagons. Each hexagon shows a piece from a random place of the image at a random
angle (after Deliot and Heitz, "Procedural Stochastic Textures by Tiling and Blending", GPU Zen 2, 2019). The three
nearest pieces are blended with the contrast of the image: mean + sum of weights x (piece - mean) / root of the sum of
squared weights (Heitz and Neyret, "High-Performance By-Example Noise using a Histogram-Preserving Blending Operator",
HPG 2018).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ...settings.topics.surfaces import TexturesSettings
from ...support.blender import compat
from ...support.labels import UV_LAYER
from ..tree.builder import Node, Socket, Tree, Triple, Value, find_output
from .images import Map

#: Hexagons per image width, each of which shows about half of the image.
_HEXAGONS_PER_WIDTH = 2.0
_ROOT_3 = math.sqrt(3.0)
#: Least z component of a face's normal for a map from above; faces below it are walls, which are mapped from the side.
_MIN_FLOOR_NORMAL = 0.5


@dataclass(frozen=True)
class Textured:
    """``textures`` settings with their maps, and the way in which the maps are laid on a surface.

    ``placement`` is POSITION, UV, PATCH, MAP, or MEAN: the mean of each image everywhere, for rocks without UV
    coordinates. ``patch_m`` is the side of the patch. With the placement MAP, ``placed`` are west and south edge of the
    image in the frame of the site, and its width and height, in metres.
    """

    settings: TexturesSettings
    maps: Mapping[str, Map]
    placement: str = "POSITION"
    patch_m: float = math.nan
    placed: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)

    def make_sampler(self, tree: Tree, geometry: Node, offset: tuple[float, float]) -> Sampler:
        """Make the sampler of the maps in a tree. ``offset``, in image widths, shifts images that are mapped by
        position."""
        if self.placement == "UV":
            return UVSampler(tree, geometry)
        if self.placement == "PATCH":
            return PatchSampler(tree, self.settings, geometry, self.patch_m)
        if self.placement == "MAP":
            return MapSampler(tree, self.settings, geometry, self.placed)
        return MeanSampler(tree) if self.placement == "MEAN" else PositionSampler(tree, self.settings, geometry, offset)


class Sampler:
    """Samples images on a surface: at each point a few pieces, each a place on the image, a weight and an angle."""

    _EXTENSION = "REPEAT"  # how an image continues beyond its edges

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.pieces: list[tuple[Any, Any, Any]] = []

    def _add_images(self, kind: str, of: Map) -> list[Any]:
        """Add the image at each piece, and return the output sockets of its colours."""
        return [
            self.tree.node(
                "ShaderNodeTexImage",
                f"{kind.title()} {k}",
                {"Vector": place},
                image=of.image,
                interpolation="Linear",
                extension=self._EXTENSION,
            ).outputs[0]
            for k, (place, _, _) in enumerate(self.pieces)
        ]

    def _add_blend(self, kind: str, values: list[Any], mean: tuple[float, float, float]) -> Socket:
        """Add mean + sum of share x (value - mean), but no albedo below 0, and return the output socket.

        The squares of the shares add up to 1, which keeps the contrast. The shares themselves add up to more.
        """
        if len(values) == 1:
            return values[0]
        total: Triple = mean
        for k, (value, (_, share, _)) in enumerate(zip(values, self.pieces, strict=True)):
            apart = self.tree.vector("SUBTRACT", f"{kind.title()} {k} Apart", value, mean)
            part = self.tree.scaled(f"{kind.title()} {k} Part", apart, share)
            total = self.tree.vector("ADD", f"{kind.title()} Sum {k}", total, part)
        return self.tree.vector("MAXIMUM", "At Least Black", total, (0.0, 0.0, 0.0)) if kind == "albedo" else total

    def sample(self, kind: str, of: Map) -> Socket:
        """Add a map's colour, blended between its repeats, and return its output socket. ``kind`` is the name of the
        map."""
        return self._add_blend(kind, self._add_images(kind, of), of.mean)

    def sample_normal(self, of: Map) -> Socket:
        """Tilt the surface's normal as a normal map states (x right, y up, z out; OpenGL), and return its output
        socket."""
        raise NotImplementedError


class MeanSampler(Sampler):
    """Samples the mean of an image everywhere."""

    def sample(self, kind: str, of: Map) -> Socket:
        return self.tree.combined(f"Mean {kind.title()}", *of.mean)


class UVSampler(Sampler):
    """Samples one piece, by the UV coordinates of the mesh."""

    _TANGENT: ClassVar[dict[str, Any]] = {"space": "TANGENT", "uv_map": UV_LAYER, **compat.NORMAL_MAP_PROPERTIES}

    def __init__(self, tree: Tree, geometry: Node) -> None:
        super().__init__(tree)
        self.normal = geometry.outputs["Normal"]
        self.pieces = [(tree.node("ShaderNodeUVMap", "UV", uv_map=UV_LAYER, from_instancer=False).outputs[0], 1.0, 0.0)]

    def sample_normal(self, of: Map) -> Socket:
        # The node uses the normal before displacement. So its change of that normal is added to the true normal.
        mapped, level = (
            self.tree.node("ShaderNodeNormalMap", label, {"Strength": 1.0, "Color": colour}, **self._TANGENT).outputs[0]
            for label, colour in (
                ("Normal Map", self._add_images("normal", of)[0]),
                ("Level Map", (0.5, 0.5, 1.0, 1.0)),
            )
        )
        tree = self.tree
        tilt = tree.vector("SUBTRACT", "Tilt", mapped, level)
        return tree.vector("NORMALIZE", "Mapped Normal", tree.vector("ADD", "Tilted", self.normal, tilt))


class PositionSampler(Sampler):
    """Samples by position: one piece for plain repeats, otherwise three."""

    def __init__(self, tree: Tree, textures: TexturesSettings, geometry: Node, offset: tuple[float, float]) -> None:
        super().__init__(tree)
        self._place(geometry, textures, offset)
        if textures.repeat == "PLAIN":
            self.pieces = [(self.plane, 1.0, 0.0)]
        else:
            self._add_hexagons(turned=textures.repeat == "TURNED")

    def chosen(self, label: str, share: Value, a: Triple, b: Triple) -> Socket:
        """Choose vector ``a`` where ``share`` is 0 and ``b`` where it is 1, and return the output socket."""
        return find_output(
            self.tree.node(
                "ShaderNodeMix",
                label,
                {"Factor_Float": share, "A_Vector": a, "B_Vector": b},
                data_type="VECTOR",
                factor_mode="UNIFORM",
                clamp_factor=True,
            ),
            "Result_Vector",
        )

    def _place(self, geometry: Node, textures: TexturesSettings, offset: tuple[float, float]) -> None:
        """Set ``plane``, the position in image widths as seen from above, or from the side on walls."""
        tree = self.tree
        at = tree.scaled("Image Widths", geometry.outputs["Position"], 1.0 / textures.width_m)
        x, y, z = tree.separated("Place", tree.vector("ADD", "Shifted", at, (*offset, 0.0)))
        self.normal = geometry.outputs["Normal"]
        size = tree.vector("ABSOLUTE", "Normal Size", geometry.outputs["True Normal"])
        east, north, up = tree.separated("Facing", size)
        self.is_wall = tree.math("LESS_THAN", "Wall", up, _MIN_FLOOR_NORMAL)
        self.faces_east = tree.math("GREATER_THAN", "Faces East", east, north)
        side = self.chosen("Side", self.faces_east, tree.combined("From South", x, z), tree.combined("From East", y, z))
        self.plane = self.chosen("Seen From", self.is_wall, tree.combined("From Above", x, y), side)

    def _add_hexagons(self, turned: bool) -> None:
        tree, math_, k = self.tree, self.tree.math, _HEXAGONS_PER_WIDTH
        skewed = tree.combined(
            "Skewed",
            tree.vector("DOT_PRODUCT", "Skewed X", self.plane, (k, -k / _ROOT_3, 0.0)),
            tree.vector("DOT_PRODUCT", "Skewed Y", self.plane, (0.0, 2 * k / _ROOT_3, 0.0)),
        )
        base = tree.vector("FLOOR", "Rhombus", skewed)
        x, y, _ = tree.separated("In Rhombus", tree.vector("FRACTION", "Rest", skewed))
        rest = math_("SUBTRACT", "Below Diagonal", 1.0, math_("ADD", "Sum", x, y))
        upper = math_("LESS_THAN", "Upper Triangle", rest, 0.0)
        beyond = math_("MULTIPLY", "Beyond Diagonal", upper, rest)
        corners = (
            ("A", tree.combined("Corner A", upper, upper), math_("ABSOLUTE", "Weight A", rest)),
            ("B", (0.0, 1.0, 0.0), math_("ADD", "Weight B", y, beyond)),
            ("C", (1.0, 0.0, 0.0), math_("ADD", "Weight C", x, beyond)),
        )
        total = tree.vector("LENGTH", "Root of Squares", tree.combined("Weights", *(w for _, _, w in corners)))
        for name, step, weight in corners:
            corner = tree.vector("ADD", f"Corner {name} At", base, step)
            middle = tree.combined(
                f"Middle {name}",
                *(
                    tree.vector("DOT_PRODUCT", f"Middle {name} {axis}", corner, row)
                    for axis, row in (("X", (1 / k, 0.5 / k, 0.0)), ("Y", (0.0, _ROOT_3 / (2 * k), 0.0)))
                ),
            )
            random = self.tree.node(
                "ShaderNodeTexWhiteNoise", f"Random {name}", {"Vector": corner}, noise_dimensions="2D"
            )
            angle: Value = 0.0
            place = self.plane
            if turned:
                angle = math_("MULTIPLY", f"Angle {name}", find_output(random, "Value"), 2 * math.pi)
                place = self.rotated(f"Turned {name}", place, angle, middle)
            moved = tree.vector("ADD", f"Piece {name}", place, find_output(random, "Color"))
            self.pieces.append((moved, math_("DIVIDE", f"Share {name}", weight, total), angle))

    def rotated(
        self, label: str, vector: Socket, angle: Value, centre: Triple = (0.0, 0.0, 0.0), back: bool = False
    ) -> Socket:
        """Rotate a vector about the third axis, and return its output socket."""
        return self.tree.node(
            "ShaderNodeVectorRotate",
            label,
            {"Vector": vector, "Center": centre, "Angle": angle},
            rotation_type="Z_AXIS",
            invert=back,
        ).outputs[0]

    def sample_normal(self, of: Map) -> Socket:
        """Tilt the surface's normal as a normal map states (x right, y up, z out; OpenGL), and return its output
        socket."""
        tree, slopes = self.tree, []
        for k, colour in enumerate(self._add_images("normal", of)):
            scaled = tree.scaled(f"Normal {k} Doubled", colour, 2.0)
            x, y, z = tree.separated(f"Normal {k} Axes", tree.vector("SUBTRACT", f"Normal {k}", scaled, (1.0,) * 3))
            level = tree.math("MAXIMUM", f"Normal {k} Out", z, 0.05)
            slope = tree.combined(
                f"Slope {k}",
                tree.math("DIVIDE", f"Slope {k} X", x, level),
                tree.math("DIVIDE", f"Slope {k} Y", y, level),
            )
            angle = self.pieces[k][2]
            slopes.append(
                slope if isinstance(angle, float) else self.rotated(f"Slope {k} Turned", slope, angle, back=True)
            )
        x, y, _ = tree.separated("Slopes", self._add_blend("normal", slopes, (0.0, 0.0, 0.0)))
        side = self.chosen(
            "Side Slopes",
            self.faces_east,
            tree.combined("South Slopes", x, 0.0, y),
            tree.combined("East Slopes", 0.0, x, y),
        )
        tilt = self.chosen("Tilt", self.is_wall, tree.combined("Top Slopes", x, y), side)
        return tree.vector("NORMALIZE", "Mapped Normal", tree.vector("ADD", "Tilted", self.normal, tilt))


class PatchSampler(PositionSampler):
    """Samples one piece: the whole image over the patch, seen from above. Beyond the patch, its outermost pixels
    continue."""

    _EXTENSION = "EXTEND"

    def __init__(self, tree: Tree, textures: TexturesSettings, geometry: Node, patch_m: float) -> None:
        super().__init__(tree, textures | {"repeat": "PLAIN", "width_m": patch_m}, geometry, (0.5, 0.5))

    def _place(self, geometry: Node, textures: TexturesSettings, offset: tuple[float, float]) -> None:
        tree = self.tree
        at = tree.scaled("Patch Widths", geometry.outputs["Position"], 1.0 / textures.width_m)
        x, y, _ = tree.separated("Place", tree.vector("ADD", "From Corner", at, (*offset, 0.0)))
        self.normal, self.is_wall, self.faces_east = geometry.outputs["Normal"], 0.0, 0.0
        self.plane = tree.combined("From Above", x, y)


@dataclass(frozen=True)
class Painted:
    """Painted masks by their kind, dirt or frost, over the patch of side ``patch_m``."""

    masks: Mapping[str, Map]
    patch_m: float

    def make_sampler(self, tree: Tree, geometry: Node) -> PaintedSampler:
        """Make the sampler of the masks in a tree."""
        return PaintedSampler(self, tree, geometry)


class PaintedSampler:
    """Samples painted masks; a kind without a mask gets no nodes."""

    def __init__(self, painted: Painted, tree: Tree, geometry: Node) -> None:
        self._painted, self._tree = painted, tree
        self._place = PatchSampler(tree, TexturesSettings.from_values({"repeat": "PLAIN"}), geometry, painted.patch_m)

    def sample_share(self, kind: str) -> Value:
        """Add the mask of this kind, from 0 to 1, and return its output socket; 1.0 without a mask."""
        of = self._painted.masks.get(kind)
        return (
            1.0
            if of is None
            else self._tree.separated(f"{kind.title()} Mask", self._place.sample(f"{kind} mask", of))[0]
        )


class MapSampler(PatchSampler):
    """Samples one image that lies on the map of the ground, with a separate width and height."""

    def __init__(
        self, tree: Tree, textures: TexturesSettings, geometry: Node, placed: tuple[float, float, float, float]
    ) -> None:
        self._placed = placed
        super().__init__(tree, textures, geometry, 1.0)

    def _place(self, geometry: Node, textures: TexturesSettings, offset: tuple[float, float]) -> None:
        tree = self.tree
        west, south, width, height = self._placed
        moved = tree.vector("SUBTRACT", "From Corner", geometry.outputs["Position"], (west, south, 0.0))
        x, y, _ = tree.separated("Place", tree.vector("DIVIDE", "Image Sizes", moved, (width, height, 1.0)))
        self.normal, self.is_wall, self.faces_east = geometry.outputs["Normal"], 0.0, 0.0
        self.plane = tree.combined("From Above", x, y)
