"""Builders of meshes, materials and lights. They take plain settings and return data-blocks."""
