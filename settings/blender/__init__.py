"""The settings as properties of a Blender scene."""
