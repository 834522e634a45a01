"""The evaluation: stereo matchers run on rendered pairs and are measured against the true depth.

It runs as a separate process, ``python -m icymoon.stereo …``, in a Python with NumPy, OpenCV, OpenEXR, Jinja2,
Matplotlib and Rich. Nothing here imports Blender.
"""
