"""Hidden points against a scene of two planes, whose edges are known."""

import numpy as np
import pytest
from icymoon.physics.camera.occlusion import find_hidden, find_matching_column, sample_at_columns

pytestmark = pytest.mark.filterwarnings("error")

WIDTH, FAR_PX = 64, 3.0
#: Where the near plane begins and ends in the right image, px from its left border.
BEGIN, END = 20.3, 31.85


def plane_with_patch(nearer_px, rays):
    """Disparity (1, 64) of the left eye's pixel centres and (1, 64 rays) of the right eye's rays, in px: a plane at
    FAR_PX, and before it a patch that is nearer by ``nearer_px``."""
    near = FAR_PX + nearer_px
    in_left, in_right = np.arange(WIDTH) + 0.5, 0.5 + np.arange(WIDTH * rays) / rays
    left = np.where((in_left - near >= BEGIN) & (in_left - near < END), near, FAR_PX)
    return left[None], np.where((in_right >= BEGIN) & (in_right < END), near, FAR_PX)[None]


@pytest.mark.parametrize("rays", [1, 2, 4, 8])
@pytest.mark.parametrize("nearer_px", [0.3, 1.0, 2.5, 8.0])
def test_what_is_behind_the_patch_is_hidden_to_a_ray_at_its_edges(rays, nearer_px):
    left, right = plane_with_patch(nearer_px, rays)
    place = np.arange(WIDTH) + 0.5 - FAR_PX  # of the far plane's points, in the right image
    hidden = (left[0] == FAR_PX) & (place >= BEGIN) & (place < END)
    at_an_edge = np.minimum(np.abs(place - BEGIN), np.abs(place - END)) < 1 / rays
    found = find_hidden(left, right, "left")[0]
    assert hidden.sum() >= (nearer_px > 1)
    np.testing.assert_array_equal(found[~at_an_edge], hidden[~at_an_edge])


def test_more_rays_find_an_edge_to_a_fraction_of_a_pixel():
    """The patch's edge moves through a pixel; a point beside it turns hidden where it reaches it, to half a ray."""
    wrong = {}
    for rays in (1, 8):
        wrong[rays] = 0
        far = 3.37  # so that points of the far plane fall between the rays
        place = np.arange(WIDTH) + 0.5 - far
        for begin in np.linspace(20.0, 21.0, 81):
            right = np.where(0.5 + np.arange(WIDTH * rays) / rays >= begin, far + 5, far)[None]
            hidden = find_hidden(np.full((1, WIDTH), far), right, "left")[0]
            wrong[rays] += int((hidden != (place >= begin))[place > 0].sum())
    assert wrong[1] > 10
    assert 4 * wrong[8] <= wrong[1]


@pytest.mark.parametrize("rays", [1, 4])
@pytest.mark.parametrize("slope", [-0.5, 0.0, 0.8, 3.0])
def test_a_plane_hides_nothing_of_itself(slope, rays):
    """Disparity is affine in the column of either eye; ``slope`` is per column of the right one."""
    at_right = np.clip(0.5 + np.arange(WIDTH * rays) / rays, None, 40)
    right = 5 + slope * at_right
    in_left = np.arange(WIDTH) + 0.5
    left = (5 + slope * in_left) / (1 + slope)  # where x_left - d = x_right
    seen = (in_left - left > 0.5) & (in_left - left < 39)  # between rays, and on the plane
    assert not find_hidden(left[None], right[None], "left")[0][seen].any()


def test_the_right_eye_is_a_left_eye_in_the_mirror():
    left, right = plane_with_patch(4.0, 4)
    found = find_hidden(left, right, "left")
    np.testing.assert_array_equal(find_hidden(left[:, ::-1], right[:, ::-1], "right"), found[:, ::-1])
    assert found.sum() >= 3


def test_sky_hides_nothing_and_is_not_hidden():
    left, right = plane_with_patch(4.0, 4)
    assert not find_hidden(left, np.full_like(right, np.nan), "left").any()
    assert not find_hidden(np.full_like(left, np.nan), right, "left").any()


def test_a_point_beyond_the_frame_is_not_called_hidden():
    left = np.full((1, WIDTH), 10.0)
    right = np.full((1, WIDTH), 20.0)  # everything in the frame has something nearer before it
    np.testing.assert_array_equal(find_hidden(left, right, "left")[0], np.arange(WIDTH) >= 10)


def test_columns_between_pixels_are_interpolated():
    image = np.array([[0.0, 10.0, 30.0]])
    np.testing.assert_array_equal(
        sample_at_columns(image, np.array([[-1.0, 0.25, 1.5, 2.0, 5.0]])), [[0, 2.5, 20, 30, 30]]
    )
    np.testing.assert_array_equal(find_matching_column(np.array([[1.0, 1.0]]), "right"), [[1.0, 2.0]])
