"""Images on the ground that show no repeats.

The plane is cut into hexagons that each take their piece from another place of the image, turned by
another angle, and the three nearest pieces are blended so that contrast stays what it was in the image
(Heitz and Neyret, "High-Performance By-Example Noise using a Histogram-Preserving Blending Operator", HPG 2018:
mean + sum of weights x (piece - mean) / root of the sum of squared weights; the hexagons after Deliot and Heitz,
"Procedural Stochastic Textures by Tiling and Blending", GPU Zen 2, 2019).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..errors import IcyMoonError
from ..physics.textures import SIZE, maps
from .builder import Tree, output

#: Hexagons per image width: each shows about half of the image.
_HEXAGONS = 2.0
_ROOT_3 = math.sqrt(3.0)
#: Slope above which a wall is seen from the side: the height of its normal is under this.
_WALL = 0.5
_KEY, _MEAN = "icymoon_key", "icymoon_mean"  # what an image was made for, and the mean of its linear values


@dataclass(frozen=True)
class Map:
    """An image of one kind and the mean (3,) of its linear values."""

    image: bpy.types.Image
    mean: tuple[float, float, float]


def load_maps(textures: Mapping[str, Any], files: Mapping[str, Path]) -> dict[str, Map]:
    """The maps that ``textures`` settings name, by kind; none if there is no texture.

    ``files`` has the file of each kind of the person's own set. An image that is there already is taken again.
    Raises IcyMoonError if one cannot be read.
    """
    if textures["set"] == "NONE":
        return {}
    if textures["set"] == "OWN":
        if not files:
            raise IcyMoonError("textures.set is OWN, but no image is named; name one, such as textures.albedo_file.")
        return {kind: _loaded(kind, path) for kind, path in files.items()}
    return {kind: _made(textures["set"], kind) for kind in ("albedo", "roughness", "height")}


def remove_unused_images() -> None:
    """Remove the images of textures that nothing shows."""
    unused = [image for image in bpy.data.images if _KEY in image and image.users == 0]
    if unused:
        bpy.data.batch_remove(unused)


def _there(key: str) -> Map | None:
    """The map whose image was made for the same ``key`` before."""
    image = next((image for image in bpy.data.images if image.get(_KEY) == key), None)
    return Map(image, tuple(image[_MEAN])) if image else None


def _kept(key: str, image: bpy.types.Image, values: np.ndarray) -> Map:
    """A map of an image with linear ``values`` (n, 3), to be found again."""
    mean = tuple(float(v) for v in values.mean(axis=0, dtype=np.float64))
    image[_KEY], image[_MEAN] = key, mean
    return Map(image, mean)  # type: ignore[arg-type]


def _made(name: str, kind: str) -> Map:
    key = f"{name} {kind}"
    there = _there(key)
    if there is not None:
        return there
    values = getattr(maps(name), kind)
    image = bpy.data.images.new(f"Icy Moon {key.title()}", SIZE, SIZE, float_buffer=True, is_data=True)
    pixels = np.ones((SIZE, SIZE, 4), np.float32)
    pixels[..., :3] = values[..., None]
    image.pixels.foreach_set(pixels.ravel())
    image.pack()  # else it is lost when the file is saved
    return _kept(key, image, pixels[..., :3].reshape(-1, 3))


def _loaded(kind: str, path: Path) -> Map:
    name = f"textures.{kind}_file"
    if not path.is_file():
        raise IcyMoonError(f"{path}: there is no such file; check {name}.")
    state = path.stat()
    key = f"{path} {state.st_size} {state.st_mtime_ns} {kind}"
    there = _there(key)
    if there is not None:
        return there
    image = bpy.data.images.load(str(path), check_existing=False)
    if kind != "albedo" and not image.is_float:
        image.colorspace_settings.name = "Non-Color"
    try:
        return _kept(key, image, _linear(path, name, image))
    except IcyMoonError:
        bpy.data.images.remove(image)
        raise


def _linear(path: Path, name: str, image: bpy.types.Image) -> np.ndarray:
    """Linear values (n, 3) of an image's pixels. Raises IcyMoonError if it has none or some are not numbers."""
    width, height = image.size
    if width * height == 0:
        raise IcyMoonError(f"{path}: is not an image that Blender reads; give a PNG, JPEG, TIFF or EXR as {name}.")
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    values = pixels.reshape(-1, image.channels)
    values = values[:, :3] if image.channels >= 3 else np.repeat(values[:, :1], 3, axis=1)
    if not np.isfinite(values).all():
        raise IcyMoonError(f"{path}: has pixels that are not numbers; mend the image or choose another for {name}.")
    if image.colorspace_settings.name == "sRGB" and not image.is_float:
        values = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return values


class Pieces:
    """Where on the image each point looks, and with what weight: one piece of a plain repeat, or three."""

    def __init__(self, tree: Tree, textures: Mapping[str, Any], geometry: Any, offset: tuple[float, float]) -> None:
        self.tree = tree
        self._place(geometry, textures, offset)
        self.pieces: list[tuple[Any, Any, Any]] = []  # place on the image, weight, angle
        if textures["repeat"] == "PLAIN":
            self.pieces = [(self.plane, 1.0, 0.0)]
        else:
            self._hexagons(turned=textures["repeat"] == "TURNED")

    def vector(self, operation: str, label: str, a: Any, b: Any = None, *, scale: Any = None) -> Any:
        """Output socket of a Vector Math node."""
        inputs = {"Vector": a}
        if scale is not None:
            inputs["Scale"] = scale
        elif b is not None:
            inputs["Vector_001"] = b
        node = self.tree.node("ShaderNodeVectorMath", label, inputs, operation=operation)
        return output(node, "Value" if operation in ("DOT_PRODUCT", "LENGTH") else "Vector")

    def combined(self, label: str, x: Any, y: Any, z: Any = 0.0) -> Any:
        """Output socket of a vector of three numbers."""
        return self.tree.node("ShaderNodeCombineXYZ", label, {"X": x, "Y": y, "Z": z}).outputs[0]

    def separated(self, label: str, vector: Any) -> tuple[Any, Any, Any]:
        """Output sockets of a vector's three numbers."""
        node = self.tree.node("ShaderNodeSeparateXYZ", label, {"Vector": vector})
        return node.outputs[0], node.outputs[1], node.outputs[2]

    def chosen(self, label: str, share: Any, a: Any, b: Any) -> Any:
        """Output socket of vector ``a`` where ``share`` is 0 and ``b`` where it is 1."""
        return output(self.tree.node("ShaderNodeMix", label, {"Factor_Float": share, "A_Vector": a, "B_Vector": b},
                                     data_type="VECTOR", factor_mode="UNIFORM", clamp_factor=True), "Result_Vector")

    def _place(self, geometry: Any, textures: Mapping[str, Any], offset: tuple[float, float]) -> None:
        """``plane``: place in image widths, seen from above, or from the side on walls."""
        math_ = self.tree.math
        at = self.vector("SCALE", "Image Widths", geometry.outputs["Position"], scale=1.0 / textures["width_m"])
        x, y, z = self.separated("Place", self.vector("ADD", "Shifted", at, (*offset, 0.0)))
        self.normal = geometry.outputs["Normal"]
        size = self.vector("ABSOLUTE", "Normal Size", geometry.outputs["True Normal"])
        east, north, up = self.separated("Facing", size)
        self.is_wall = math_("LESS_THAN", "Wall", up, _WALL)
        self.faces_east = math_("GREATER_THAN", "Faces East", east, north)
        side = self.chosen("Side", self.faces_east, self.combined("From South", x, z), self.combined("From East", y, z))
        self.plane = self.chosen("Seen From", self.is_wall, self.combined("From Above", x, y), side)

    def _hexagons(self, turned: bool) -> None:
        math_, k = self.tree.math, _HEXAGONS
        skewed = self.combined("Skewed", self.vector("DOT_PRODUCT", "Skewed X", self.plane, (k, -k / _ROOT_3, 0.0)),
                               self.vector("DOT_PRODUCT", "Skewed Y", self.plane, (0.0, 2 * k / _ROOT_3, 0.0)))
        base = self.vector("FLOOR", "Rhombus", skewed)
        x, y, _ = self.separated("In Rhombus", self.vector("FRACTION", "Rest", skewed))
        rest = math_("SUBTRACT", "Below Diagonal", 1.0, math_("ADD", "Sum", x, y))
        upper = math_("LESS_THAN", "Upper Triangle", rest, 0.0)
        beyond = math_("MULTIPLY", "Beyond Diagonal", upper, rest)
        corners = (
            ("A", self.combined("Corner A", upper, upper), math_("ABSOLUTE", "Weight A", rest)),
            ("B", (0.0, 1.0, 0.0), math_("ADD", "Weight B", y, beyond)),
            ("C", (1.0, 0.0, 0.0), math_("ADD", "Weight C", x, beyond)))
        total = self.vector("LENGTH", "Root of Squares", self.combined("Weights", *(w for _, _, w in corners)))
        for name, step, weight in corners:
            corner = self.vector("ADD", f"Corner {name} At", base, step)
            middle = self.combined(f"Middle {name}", *(
                self.vector("DOT_PRODUCT", f"Middle {name} {axis}", corner, row)
                for axis, row in (("X", (1 / k, 0.5 / k, 0.0)), ("Y", (0.0, _ROOT_3 / (2 * k), 0.0)))))
            random = self.tree.node("ShaderNodeTexWhiteNoise", f"Random {name}", {"Vector": corner},
                                    noise_dimensions="2D")
            angle: Any = 0.0
            place = self.plane
            if turned:
                angle = math_("MULTIPLY", f"Angle {name}", output(random, "Value"), 2 * math.pi)
                place = self.rotated(f"Turned {name}", place, angle, middle)
            moved = self.vector("ADD", f"Piece {name}", place, output(random, "Color"))
            self.pieces.append((moved, math_("DIVIDE", f"Share {name}", weight, total), angle))

    def rotated(self, label: str, vector: Any, angle: Any, centre: Any = (0.0, 0.0, 0.0), back: bool = False) -> Any:
        """Output socket of a vector turned about the third axis."""
        return self.tree.node("ShaderNodeVectorRotate", label, {"Vector": vector, "Center": centre, "Angle": angle},
                              rotation_type="Z_AXIS", invert=back).outputs[0]

    def _images(self, kind: str, image: bpy.types.Image) -> list[Any]:
        """Output sockets of the image's colour at each piece."""
        return [self.tree.node("ShaderNodeTexImage", f"{kind.title()} {k}", {"Vector": place}, image=image,
                               interpolation="Linear", extension="REPEAT").outputs[0]
                for k, (place, _, _) in enumerate(self.pieces)]

    def _blended(self, kind: str, values: list[Any], mean: tuple[float, float, float]) -> Any:
        """mean + sum of share x (value - mean)."""
        if len(values) == 1:
            return values[0]
        total: Any = mean
        for k, (value, (_, share, _)) in enumerate(zip(values, self.pieces, strict=True)):
            apart = self.vector("SUBTRACT", f"{kind.title()} {k} Apart", value, mean)
            total = self.vector("ADD", f"{kind.title()} Sum {k}", total,
                                self.vector("SCALE", f"{kind.title()} {k} Part", apart, scale=share))
        return total

    def sample(self, kind: str, of: Map) -> Any:
        """Output socket of the blended colour of a map."""
        return self._blended(kind, self._images(kind, of.image), of.mean)

    def sample_normal(self, of: Map) -> Any:
        """Output socket of the surface's normal tilted as a normal map says (x right, y up, z out; OpenGL)."""
        slopes = []
        for k, colour in enumerate(self._images("normal", of.image)):
            scaled = self.vector("SCALE", f"Normal {k} Doubled", colour, scale=2.0)
            x, y, z = self.separated(f"Normal {k} Axes", self.vector("SUBTRACT", f"Normal {k}", scaled, (1.0,) * 3))
            level = self.tree.math("MAXIMUM", f"Normal {k} Out", z, 0.05)
            slope = self.combined(f"Slope {k}", self.tree.math("DIVIDE", f"Slope {k} X", x, level),
                                  self.tree.math("DIVIDE", f"Slope {k} Y", y, level))
            angle = self.pieces[k][2]
            slopes.append(slope if isinstance(angle, float) else self.rotated(f"Slope {k} Turned", slope, angle,
                                                                              back=True))
        x, y, _ = self.separated("Slopes", self._blended("normal", slopes, (0.0, 0.0, 0.0)))
        side = self.chosen("Side Slopes", self.faces_east, self.combined("South Slopes", x, 0.0, y),
                           self.combined("East Slopes", 0.0, x, y))
        tilt = self.chosen("Tilt", self.is_wall, self.combined("Top Slopes", x, y), side)
        return self.vector("NORMALIZE", "Mapped Normal", self.vector("ADD", "Tilted", self.normal, tilt))
