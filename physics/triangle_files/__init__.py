"""Triangles from STL and OBJ files, for the rooms that need no Blender."""
