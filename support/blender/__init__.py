"""What differs between versions of Blender."""
