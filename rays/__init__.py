"""Rays against triangles: the first triangle that a ray meets, and whether a ray is blocked. Imports no Blender."""
