"""The export ``ros2``: a bag of ROS 2 with images, camera infos, true disparity, true points and poses of all pairs.

The package rosbags writes it, without ROS. Frames of a sequence have their stamps, and come in the order of time; any
other pair k has the time k s. Both camera infos are in the frame of the left camera's optics (x right, y down, z
forward), as stereo_image_proc expects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.rotations import quaternion
from ...physics.camera.stereo_camera import StereoCamera
from ...render.pairs.pair_folder import EYES
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..images.develop import to_8_bit
from ..measure.prepare_pair import LoadedPair
from .bag_file import WORLD_FRAME, open_bag
from .cameras import make_centred_matrix, make_pixel_rays, read_pose, refuse_row_poses
from .losses import Each

#: Makers of messages by their names.
Kinds = Mapping[str, Callable[..., object]]

HEADINGS = {"ros2": "Sequences"}
TITLES = {"ros2": "ROS 2 Bag: images, camera infos, true disparity, true points and poses"}
FRAMES = {"left": "stereo_left_optical", "right": "stereo_right_optical"}
_NS_PER_S, _MAX_SECONDS = 1_000_000_000, 2**31


def write_all(each: Each, out: Path) -> None:
    """Write the bag ``<out>/pairs`` (MCAP). Raises IcyMoonError if there is a bag already.

    Its topics are ``/stereo/left/image_rect``, ``/stereo/left/camera_info``, for a colour sensor also
    ``/stereo/left/image_rect_color``, the same of the right eye, ``/stereo/disparity``, ``/stereo/points2`` and
    ``/tf``.
    """
    with open_bag(out / "pairs") as (add, types):
        count = 0

        def write(pair: LoadedPair) -> None:
            nonlocal count
            time = _find_time_ns(pair, count)
            for topic, message in make_messages(pair, types, time):
                add(topic, message, time)
            count += 1

        each(write)


def _find_time_ns(pair: LoadedPair, count: int) -> int:
    """Find the time, ns, of the pair that follows ``count`` other pairs. Raises IcyMoonError if ROS cannot hold it."""
    stamp = pair.settings.rig.stamp
    time = int(Decimal(stamp) * _NS_PER_S) if stamp else count * _NS_PER_S
    if not 0 <= time < _MAX_SECONDS * _NS_PER_S:
        raise IcyMoonError(
            f"{pair.pair.folder} has the stamp {stamp} s, and times of ROS are 0 to {_MAX_SECONDS} s; export tum "
            "instead."
        )
    return time


def make_messages(pair: LoadedPair, types: Any, time: int) -> Iterator[tuple[str, Any]]:
    """Yield (topic, message) of everything about a pair.

    ``types`` is a typestore of rosbags, ``time`` is in nanoseconds.
    """
    refuse_row_poses(pair)
    kinds = types.types
    stamp = kinds["builtin_interfaces/msg/Time"](sec=time // _NS_PER_S, nanosec=time % _NS_PER_S)

    def header(frame: str) -> object:
        return kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)

    def developed(numbers: Array, colours: str) -> object:
        bits = 8 if pair.images.bits == 8 else 16
        pixels = to_8_bit(numbers, 8, pair.images.encoding) if bits == 8 else numbers.astype(np.uint16)
        return _make_image(pixels, f"{colours}{bits}", kinds, optical)

    optical = header(FRAMES["left"])
    for eye in EYES:
        yield f"/stereo/{eye}/image_rect", developed(getattr(pair.images, eye), "mono")
        if pair.images.is_mosaic:
            yield f"/stereo/{eye}/image_rect_color", developed(pair.images.seen(eye), "rgb")
        yield f"/stereo/{eye}/camera_info", _make_camera_info(pair.pair.camera, eye, kinds, optical)
    yield "/stereo/disparity", _make_disparity(pair, kinds, optical)
    yield "/stereo/points2", _make_point_cloud(pair, kinds, optical)
    yield "/tf", _make_transforms(pair, kinds, header)


def _make_image(pixels: Array, encoding: str, kinds: Kinds, header: object) -> object:
    rows, columns = pixels.shape[:2]
    data = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<"))
    return kinds["sensor_msgs/msg/Image"](
        header=header,
        height=rows,
        width=columns,
        encoding=encoding,
        is_bigendian=0,
        step=pixels[0].size * pixels.dtype.itemsize,
        data=np.frombuffer(data.tobytes(), np.uint8),
    )


def _make_camera_info(camera: StereoCamera, eye: str, kinds: Kinds, header: object) -> object:
    # ROS counts the principal point from the centre of the first pixel.
    matrix = make_centred_matrix(camera)
    shift = -camera.focal_baseline_px_m * EYES.index(eye)
    return kinds["sensor_msgs/msg/CameraInfo"](
        header=header,
        height=camera.height_px,
        width=camera.width_px,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=matrix.ravel(),
        r=np.eye(3).ravel(),
        p=np.column_stack([matrix, [shift, 0.0, 0.0]]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=_make_region(kinds, 0, 0),
    )


def _make_region(kinds: Kinds, height: int, width: int) -> object:
    return kinds["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=height, width=width, do_rectify=False
    )


def _make_disparity(pair: LoadedPair, kinds: Kinds, header: object) -> object:
    """Make the message of the true disparity of the left pixels, NaN for none."""
    camera = pair.pair.camera
    disparity = camera.disparity(pair.depth["left"])
    known = np.isfinite(disparity)
    least, most = (float(disparity[known].min()), float(disparity[known].max())) if known.any() else (0.0, 0.0)
    return kinds["stereo_msgs/msg/DisparityImage"](
        header=header,
        image=_make_image(np.where(known, disparity, np.nan).astype(np.float32), "32FC1", kinds, header),
        f=camera.focal_px,
        t=camera.baseline_m,
        valid_window=_make_region(kinds, camera.height_px, camera.width_px),
        min_disparity=least,
        max_disparity=most,
        delta_d=0.0,
    )


def _make_point_cloud(pair: LoadedPair, kinds: Kinds, header: object) -> object:
    """Make an organised cloud of the true points of the left pixels, in the left camera's axes, NaN for none."""
    camera, depth = pair.pair.camera, pair.depth["left"]
    points = (make_pixel_rays(camera) * depth[..., None]).astype("<f4")
    fields = [
        kinds["sensor_msgs/msg/PointField"](name=name, offset=4 * k, datatype=7, count=1)
        for k, name in enumerate("xyz")
    ]
    return kinds["sensor_msgs/msg/PointCloud2"](
        header=header,
        height=camera.height_px,
        width=camera.width_px,
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * camera.width_px,
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=False,
    )


def _make_transforms(pair: LoadedPair, kinds: Kinds, header: Callable[[str], object]) -> object:
    """Make the message with the poses of both cameras on the map: east, north, up, in metres."""
    found = []
    for eye in EYES:
        pose = read_pose(pair, eye)
        w, x, y, z = map(float, quaternion(pose[:3, :3]))
        along = dict(zip("xyz", map(float, pose[:3, 3]), strict=True))
        found.append(
            kinds["geometry_msgs/msg/TransformStamped"](
                header=header(WORLD_FRAME),
                child_frame_id=FRAMES[eye],
                transform=kinds["geometry_msgs/msg/Transform"](
                    translation=kinds["geometry_msgs/msg/Vector3"](**along),
                    rotation=kinds["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
                ),
            )
        )
    return kinds["tf2_msgs/msg/TFMessage"](transforms=found)
