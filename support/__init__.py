"""Code that all layers use: errors, files, foreign bytes, the operating system, terminal output. Imports no Blender."""
