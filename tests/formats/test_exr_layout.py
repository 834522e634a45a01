"""The structural check of EXR files against files that an EXR library wrote."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest
from icymoon.formats.exr_layout import is_whole
from icymoon.formats.exr_parts import Piece, assemble, join_layers, read_pieces

COMPRESSIONS = ("NO_COMPRESSION", "RLE_COMPRESSION", "ZIPS_COMPRESSION", "ZIP_COMPRESSION", "PIZ_COMPRESSION")


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("height", [1, 16, 53])
def test_a_whole_file_is_whole_and_no_beginning_of_it_is(tmp_path, compression, parts, height):
    pixels = np.random.default_rng(0).random((height, 31)).astype(np.float32)
    header = {"compression": getattr(OpenEXR, compression), "type": OpenEXR.scanlineimage}
    path = tmp_path / "a.exr"
    OpenEXR.File([OpenEXR.Part(dict(header), {"Z": pixels.copy()}, f"p{k}") for k in range(parts)]).write(str(path))
    assert is_whole(path)
    data = path.read_bytes()
    for length in {0, 1, 8, 100, len(data) // 2, len(data) - 1}:
        cut = tmp_path / "cut.exr"
        cut.write_bytes(data[:length])
        assert not is_whole(cut), length


def test_what_is_no_exr_is_not_whole(tmp_path):
    assert not is_whole(tmp_path / "absent.exr")
    (tmp_path / "a.exr").write_bytes(b"not an image" * 100)
    assert not is_whole(tmp_path / "a.exr")


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("parts", [1, 3])
def test_joined_files_hold_the_same_pixels_and_nothing_of_the_run(tmp_path, compression, parts):
    random = np.random.default_rng(0)
    pixels = {
        layer: [random.random((53, 31)).astype(np.float32) for _ in range(parts)] for layer in ("Beauty", "Truth")
    }

    def written(date: str) -> dict[str, list[Piece]]:
        files = {}
        for layer, images in pixels.items():
            header = {
                "compression": getattr(OpenEXR, compression),
                "type": OpenEXR.scanlineimage,
                "Date": date,
                "RenderTime": date,
                "Software": "Blender",
                f"cycles.{layer}.synchronization_time": date,
            }
            path = tmp_path / f"{layer}.exr"
            OpenEXR.File(
                [
                    OpenEXR.Part(dict(header), {f"{layer}.{k}.Z": image.copy()}, f"{layer}.{k}")
                    for k, image in enumerate(images)
                ]
            ).write(str(path))
            files[layer] = read_pieces(path.read_bytes())
        return files

    data = join_layers(written("today"))
    assert data == join_layers(written("the day after"))
    path = tmp_path / "joined.exr"
    path.write_bytes(data)
    assert is_whole(path)
    found = OpenEXR.File(str(path), separate_channels=True).parts
    assert len(found) == 2 * parts
    assert len({part.header["name"] for part in found}) == 2 * parts
    for part, (layer, k) in zip(found, [(layer, k) for layer in pixels for k in range(parts)], strict=True):
        assert np.array_equal(part.channels[f"{layer}.{k}.Z"].pixels, pixels[layer][k])
        assert part.header["Software"] == "Blender"
        assert not {name for name in part.header if name in ("Date", "RenderTime") or name.startswith("cycles.")}


def test_a_file_taken_apart_and_put_together_is_the_same_image(tmp_path):
    path = tmp_path / "a.exr"
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File([OpenEXR.Part(dict(header), {"Z": np.full((20, 3), k, np.float32)}, f"p{k}") for k in range(3)]).write(
        str(path)
    )
    assert [piece.name for piece in read_pieces(path.read_bytes())] == ["p0", "p1", "p2"]
    path.write_bytes(assemble(read_pieces(path.read_bytes())[1:]))
    found = OpenEXR.File(str(path), separate_channels=True).parts
    assert [float(part.channels["Z"].pixels.max()) for part in found] == [1, 2]
