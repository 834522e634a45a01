"""Geometry of the rig alone, without ground: what rocks and meshes need of it, too."""
