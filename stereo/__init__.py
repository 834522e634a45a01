"""The evaluation: stereo matchers on rendered pairs, measured against the pair's true depth.

It runs as its own process, ``python -m icymoon.stereo …``, in a Python that has NumPy, OpenCV,
OpenEXR, Jinja2, Matplotlib and Rich. Nothing in here imports Blender.
"""
