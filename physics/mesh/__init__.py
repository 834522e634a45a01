"""Vertices and triangles of a ground: how fine where, measured heights, checks of meshes."""
