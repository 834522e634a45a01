"""The settings as properties of Blender."""
