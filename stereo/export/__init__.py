"""Pairs in the layouts of other data sets."""

#: Layouts that are ours. Those of plug-ins are beside them.
EXPORTS = (
    "png8",
    "png16",
    "pfm",
    "kitti",
    "middlebury",
    "coco",
    "bop",
    "raw",
    "cahvor",
    "colmap",
    "fits",
    "tiff",
    "ros2",
    "webdataset",
    "sceneflow",
    "parquet-index",
    "mitsuba",
    "dem",
    "ply",
    "obj",
    "usd",
    "gltf",
)
