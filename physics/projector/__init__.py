"""Pattern projectors: their device, patterns, decoding, and their contrast on ice. Imports no Blender."""
