"""PNG files that are encoded here, decoded by OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from icymoon.formats.png import encode_png


@pytest.mark.parametrize("level", [0, 1, 9])
@pytest.mark.parametrize("size", [(1, 1), (7, 5), (31, 200)])
def test_they_are_what_was_encoded(size, level):
    picture = np.random.default_rng(1).integers(0, 256, (*size, 3), np.uint8)
    decoded = cv2.imdecode(np.frombuffer(encode_png(picture, level), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(decoded[..., ::-1], picture)
