"""Stand-ins for the unpublished textures and meshes of the GUISS paper, and the known facts about the originals.

The names are from the paper's public code (its lists of textures and meshes). The appearance of the images and meshes
is not published there, so the content of a stand-in is a guess unless its name describes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class TextureItem:
    """A stand-in texture. ``paper`` is the name in the paper's public code, ``known`` further known facts. ``mean`` is
    the mean green value of its albedo image. ``occluded`` is true if the paper uses ambient occlusion as the colour."""

    number: int
    key: str
    title: str
    paper: str
    known: str
    width_m: float
    mean: float
    photograph: bool = False
    transmission: bool = False
    occluded: bool = False

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of the texture's images that the render uses, as in the paper."""
        if self.photograph:
            return ("albedo",)
        return ("albedo", "roughness", "normal", *["transmission"] * self.transmission)

    @property
    def stem(self) -> str:
        """The name of its files."""
        return self.key.lower()

    @property
    def names(self) -> tuple[str, ...]:
        """The names by which a user's own file replaces it; the stand-in's own name is last."""
        return (f"texture_{self.number:02}", self.paper, self.stem)


@dataclass(frozen=True)
class MeshItem:
    """A stand-in mesh, ``size_m`` wide, with about ``triangles`` triangles before its rim is cut, and with ``holes``.

    ``sites`` are places for a camera, in metres east and north of its middle.
    """

    number: int
    key: str
    title: str
    paper: str
    known: str
    size_m: float
    triangles: int
    holes: int
    sites: tuple[tuple[float, float], ...]

    @property
    def stem(self) -> str:
        """The name of its files."""
        return self.key.lower()

    @property
    def names(self) -> tuple[str, ...]:
        """The names by which a user's own file replaces it; the stand-in's own name is last."""
        return tuple(dict.fromkeys((self.paper.lower(), self.stem)))


# Known facts about the originals, for ``known``.
_PHOTOGRAPH = "a photograph of that name that was not available; its size is not stated"
_PLAIN_SET = "a material of that name with roughness and normals, not seen; its size is not stated"
_AO_SET = "a material of that name with roughness and normals, whose ambient occlusion is used as its colour; not seen"
_FULL_SET = ("a material of that name with roughness, normals and transmission, whose ambient occlusion is used as its "
             "colour; not seen")

TEXTURES = (
    TextureItem(1, "SNOW_CRYSTALS", "Snow Crystals", "aaron-burden-2GwUjTNX1CE-unsplash",
                _PHOTOGRAPH, 0.25, 0.55, photograph=True),
    TextureItem(2, "HOAR_FROST", "Hoar Frost", "aaron-burden-if9vJoHDQes-unsplash",
                _PHOTOGRAPH, 0.4, 0.55, photograph=True),
    TextureItem(3, "SNOW_DRIFT", "Rippled Drift", "angele-kamp-g8IEMx8p_z8-unsplash",
                _PHOTOGRAPH, 4.0, 0.55, photograph=True),
    TextureItem(4, "CRUSTED_SNOW", "Broken Crust", "bernd-dittrich-gGpe31OT6hQ-unsplash",
                _PHOTOGRAPH, 1.5, 0.55, photograph=True),
    TextureItem(5, "CRACKED_ICE", "Cracked Ice", "maaike-vrijenhoek--j-xuE8rZrg-unsplash",
                _PHOTOGRAPH, 2.0, 0.30, photograph=True),
    TextureItem(6, "POWDER_SNOW", "Powder Snow", "powder-snow-texture", "a photograph of powder snow; its size is not "
                "stated", 1.0, 0.60, photograph=True),
    TextureItem(7, "GROUND_SNOW", "Snow on Ground", "Ground_Snow_seylmwd", "ground with snow, by its name: colour, "
                "roughness, normals and transmission; not seen", 2.0, 0.58, transmission=True),
    TextureItem(8, "LUMPY_SNOW", "Lumpy Snow", "Snow005", _PLAIN_SET, 1.5, 0.85),
    TextureItem(9, "FIRN", "Firn", "Snow009B", _PLAIN_SET, 0.8, 0.80),
    TextureItem(10, "GLACIER_ICE", "Glacier Ice", "ice_0001", _AO_SET, 2.0, 0.60, occluded=True),
    TextureItem(11, "MIXED_SNOW", "Snow and Ice Chips", "Snow_Mixed_ud4lfh2r", _FULL_SET, 1.5, 0.75, transmission=True,
                occluded=True),
    TextureItem(12, "SETTLED_SNOW", "Settled Snow", "Snow_Pure_ueiqbiefw", _FULL_SET, 1.5, 0.85, transmission=True,
                occluded=True),
    TextureItem(13, "SUNCUPS", "Suncups", "Snow_Pure_uepnbikfw", _FULL_SET, 3.0, 0.75, transmission=True,
                occluded=True),
    TextureItem(14, "SASTRUGI", "Sastrugi", "Snow_Pure_ugkieimdy", _FULL_SET, 3.0, 0.80, transmission=True,
                occluded=True),
)


def find_texture_item(key: str) -> TextureItem:
    """The stand-in texture with this name. Raises KeyError for an unknown name."""
    return _TEXTURES[key]


_TEXTURES = {item.key: item for item in TEXTURES}

_SURVEYED = ("a mesh reconstructed from photographs of that name, with one image; not published. "
                    "Its size is not stated")
_FROM_GAEA = "a mesh of that name made with the program Gaea, without an image; not published"
#: Sites are from the public code, in metres from the middle; for the largest survey they are divided by eight.
MESHES = (
    MeshItem(1, "ATHABASCA", "Glacier Surface", "Athabasca_surface_2", _SURVEYED, 16.0, 30000, 3, ((0.0, 0.0),)),
    MeshItem(2, "GLACIER_42M", "Crevassed Glacier", "42m_before_NE", _SURVEYED, 64.0, 60000, 8,
             ((3.125, -17.5), (1.25, 1.25), (-3.125, 3.125), (-13.75, 3.125))),
    MeshItem(3, "BLOODFALLS", "Stained Ice Front", "bloodfalls", _SURVEYED, 40.0, 40000, 6, ((0.0, 12.0),)),
    MeshItem(4, "SEAICE1", "Sea Ice", "seaice1", _SURVEYED, 64.0, 60000, 7,
             ((9.0, 5.0), (10.0, -18.0), (-10.0, 13.0), (-5.0, -12.0), (8.0, -5.0), (0.0, 0.0))),
    MeshItem(5, "MATANUSKA_A1", "Debris on Ice", "Matanuska_Glacier_Site_A1", _SURVEYED, 40.0, 40000, 5,
             ((-12.0, -5.0),)),
    MeshItem(6, "MATANUSKA_C1", "Ice with Boulders", "Matanuska_Glacier_Site_C1", _SURVEYED, 24.0, 40000, 5,
             ((-4.0, 4.0), (3.0, -3.0))),
    MeshItem(7, "SVALBARD1", "Snow and Meltwater", "svalbard1", _SURVEYED, 56.0, 50000, 6, ((3.0, 13.0), (5.0, 18.0))),
    MeshItem(8, "GAEA_RIDGY", "Ridges", "gaea_ridgy_terrain", _FROM_GAEA, 40.0, 40000, 0, ((0.0, 1.0),)),
    MeshItem(9, "GAEA_ROCKY_PERLIN", "Rocky Swells", "gaea_rockyPerlin", _FROM_GAEA, 40.0, 40000, 0, ((0.0, 0.0),)),
    MeshItem(10, "GAEA_ROCKY", "Rocky Terrain", "gaea_rockyTerrain", _FROM_GAEA, 40.0, 40000, 0, ((0.0, 0.0),)),
    MeshItem(11, "MATANUSKA_PLAYGROUND", "Ice with Channels", "matanuska_playgroundb",
             "an image for a mesh of that name, which no configuration uses; not published", 32.0, 40000, 4,
             ((0.0, 0.0),)),
)


def find_mesh_item(key: str) -> MeshItem:
    """The stand-in mesh with this name. Raises KeyError for an unknown name."""
    return _MESHES[key]


_MESHES = {item.key: item for item in MESHES}


def make_choices(items: Sequence[TextureItem | MeshItem]) -> tuple[tuple[str, str, str], ...]:
    """The stand-ins as choices of a setting: name, label, description."""
    return tuple((item.key, item.title, f"Replaces {item.paper} of the GUISS paper: {item.known}")
                 for item in items)
