"""The stand-ins that a scene shows, and the constants that all stand-ins share."""

from __future__ import annotations

from ..settings.topics.scene import Settings
from ..settings.topics.stand_ins import MeshItem, TextureItem, find_mesh_item, find_texture_item

#: Side in pixels of every stand-in texture.
TEXTURE_SIDE_PX = 1024
#: Side in pixels of the image of every stand-in mesh.
MESH_IMAGE_SIDE_PX = 2048
#: Number that changes with the recipe of any stand-in, so that its pairs get other ids and its files are made again.
RECIPE_NUMBER = 1


def list_items(settings: Settings) -> list[TextureItem | MeshItem]:
    """The stand-ins that complete settings show."""
    found: list[TextureItem | MeshItem] = []
    if settings.source.kind == "STAND_IN":
        found.append(find_mesh_item(settings.source.stand_in))
    if settings.textures.set == "STAND_IN":
        found.append(find_texture_item(settings.textures.stand_in))
    return found


def describe_item(item: TextureItem | MeshItem) -> str:
    """A sentence that describes a stand-in."""
    what = "mesh" if isinstance(item, MeshItem) else "texture"
    return (
        f"{item.title} ({item.key}) is a {what} made by code, in place of {item.paper} of the GUISS paper: "
        f"{item.known}. What it shows is a guess."
    )
