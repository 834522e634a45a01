"""Roughness that is stated: slopes over distances, and surfaces that have them."""
