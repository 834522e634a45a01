"""Triangles from STL and OBJ files, for the modules that need no Blender."""
