"""Geometry of the rig alone, without ground, also for rocks and meshes."""
