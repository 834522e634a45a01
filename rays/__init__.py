"""Intersects rays with triangles: the first triangle on a ray, and whether a ray is blocked. Imports no Blender."""
