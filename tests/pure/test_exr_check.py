"""The structural check of EXR files against files that an EXR library wrote."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest
from icymoon.render.exr_check import is_whole

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
