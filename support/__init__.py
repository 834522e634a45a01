"""What all floors use. Imports no Blender."""
