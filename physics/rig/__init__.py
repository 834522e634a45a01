"""Geometry of the rig alone, without ground; also used for rocks and meshes."""
