"""Describes the memory that a scene needs, for the error of a worker that ran out of memory. Imports no Blender."""

from __future__ import annotations

from pathlib import Path

from ...settings.topics.scene import Settings

#: Approximate bytes of memory: of a vertex with its faces in Blender and in Cycles; of a pixel in both eyes' passes;
#: per byte of a mesh or height map while it is read, repaired and meshed.
_BYTES_PER_VERTEX, _BYTES_PER_PIXEL, _BYTES_PER_FILE_BYTE = 300, 400, 10


def describe_shortage(settings: Settings) -> str:
    """Describe in a sentence the part of complete settings that needs most memory, and how to reduce it."""
    rig, mesh, terrain, source = (settings[topic] for topic in ("rig", "mesh", "terrain", "source"))
    needs = [
        (
            _BYTES_PER_PIXEL * rig["width_px"] * rig["height_px"],
            f"images of {rig['width_px']} x {rig['height_px']} pixels; lower rig.width_px and rig.height_px",
        )
    ]
    if source["kind"] in ("MESH", "HEIGHT_MAP"):
        path = Path(str(source["file"]))
        needs.append(
            (
                _BYTES_PER_FILE_BYTE * (path.stat().st_size if path.is_file() else 0),
                f"the ground in {path}; cut out the part that you need, or make it coarser",
            )
        )
    if source["kind"] == "PROCEDURAL" and mesh["kind"] == "GRADED":
        needs.append(
            (
                _BYTES_PER_VERTEX * mesh["most"],
                f"a ground of up to {mesh['most']} vertices; lower mesh.most or raise mesh.error_px",
            )
        )
    else:
        needs.append(
            (
                _BYTES_PER_VERTEX * terrain["resolution"] ** 2,
                f"a ground of {terrain['resolution']} x {terrain['resolution']} vertices; lower terrain.resolution",
            )
        )
    return f"There is not enough memory for this scene, most of it for {max(needs)[1]}."
