"""Pattern projectors: their device, patterns, decoding, and contrast on ice. Imports no Blender."""
