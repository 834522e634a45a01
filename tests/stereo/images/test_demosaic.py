"""Demosaicing against OpenCV's own, and along edges."""

import cv2
import numpy as np
import pytest
from icymoon.physics.camera.colour import apply_mosaic
from icymoon.stereo.images.develop import demosaic

OPENCV = {
    "RGGB": cv2.COLOR_BayerRGGB2RGB,
    "BGGR": cv2.COLOR_BayerBGGR2RGB,
    "GRBG": cv2.COLOR_BayerGRBG2RGB,
    "GBRG": cv2.COLOR_BayerGBRG2RGB,
}


@pytest.mark.parametrize("pattern", OPENCV)
def test_means_are_those_of_opencv(pattern):
    numbers = np.random.default_rng(1).integers(0, 2**16, (24, 30), np.uint16)
    found = demosaic(numbers, 16, pattern, "BILINEAR")[1:-1, 1:-1]
    # OpenCV rounds to whole numbers.
    assert np.abs(found - cv2.demosaicing(numbers, OPENCV[pattern])[1:-1, 1:-1]).max() <= 0.5


@pytest.mark.parametrize("pattern", OPENCV)
@pytest.mark.parametrize("bits", [8, 12, 16])
def test_edge_aware_demosaicing_returns_flat_colours_and_ramps_inside(pattern, bits):
    y, x = np.mgrid[:20, :24]
    planes = np.stack([60 + 4 * x, 200 - 2 * y, 40 + 2 * x + 2 * y]).astype(np.uint16)
    found = demosaic(apply_mosaic(planes, pattern), bits, pattern, "EDGE_AWARE")[4:-4, 4:-4]
    assert np.abs(found - planes.transpose(1, 2, 0)[4:-4, 4:-4]).max() <= 2 ** (bits - 16)


def test_edge_aware_demosaicing_keeps_green_on_a_steep_edge():
    y, x = np.mgrid[:64, :64]
    edge = np.where(x > 20 + 0.1 * y, 3000, 500).astype(np.uint16)
    error = {
        method: (demosaic(edge, 12, "RGGB", method)[8:-8, 8:-8, 1] - edge[8:-8, 8:-8]).std()
        for method in ("BILINEAR", "EDGE_AWARE")
    }
    # Green across the edge is half wrong at every second pixel beside it; along the edge it is right but where the edge
    # passes on to the next column.
    assert error["EDGE_AWARE"] < 0.7 * error["BILINEAR"]


@pytest.mark.parametrize("method", ["BILINEAR", "MALVAR", "EDGE_AWARE"])
def test_noise_stays_between_black_and_the_top(method):
    numbers = np.random.default_rng(2).choice(np.array([0, 4095], np.uint16), (40, 40))
    found = demosaic(numbers, 12, "GRBG", method)
    assert found.min() >= 0
    assert found.max() <= 4095
