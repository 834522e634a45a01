"""Differences between versions of Blender."""
