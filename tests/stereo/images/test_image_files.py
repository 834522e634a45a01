"""Image files read by our own code."""

import numpy as np
import pytest
from icymoon.stereo.images.image_files import read_pfm
from icymoon.support.errors import IcyMoonError


def test_pfm_of_the_other_byte_order(tmp_path):
    values = np.arange(6, dtype=">f4").reshape(2, 3)
    (tmp_path / "big.pfm").write_bytes(b"Pf\n3 2\n1.0\n" + values[::-1].tobytes())
    np.testing.assert_array_equal(read_pfm(tmp_path / "big.pfm"), values)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"Pf",
        b"P5\n2 2\n255\nabcd",
        b"Pf\n2 2\n-1\n" + b"\0" * 15,
        b"Pf\n2\n-1\n",
        b"Pf\n-1 -1\n-1\n\0\0\0\0",
        b"Pf\n2 2\nx\n" + b"\0" * 16,
        b"\xff\xfe\n\n\n\n",
    ],
)
def test_a_file_that_is_not_pfm_is_refused(tmp_path, content):
    (tmp_path / "bad.pfm").write_bytes(content)
    with pytest.raises(IcyMoonError, match=r"bad\.pfm"):
        read_pfm(tmp_path / "bad.pfm")
    with pytest.raises(IcyMoonError, match="cannot be read"):
        read_pfm(tmp_path / "none.pfm")
