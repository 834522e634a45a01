"""Rays against triangles: what they meet, and what stands in their way. Imports no Blender."""
