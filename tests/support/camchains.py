"""A camera chain of Kalibr, as text."""

from __future__ import annotations


def make_camchain(pinhole: tuple[float, ...], fisheye: tuple[float, ...], size_px: tuple[int, int]) -> str:
    """A chain of a pinhole and a fisheye camera with these focal lengths and principal points, in pixels. The second
    camera is 0.3 m to the right of the first and 0.1 m above it."""
    return f"""
cam0:
  camera_model: pinhole
  distortion_model: radtan
  distortion_coeffs: [-0.2, 0.05, 0.001, -0.002]
  intrinsics: {list(pinhole)}
  resolution: {list(size_px)}
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.3]
  - [0.0, 1.0, 0.0, 0.1]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_model: equidistant
  distortion_coeffs: [0.01, -0.003, 0.0, 0.0]
  intrinsics: {list(fisheye)}
  resolution: {list(size_px)}
"""
