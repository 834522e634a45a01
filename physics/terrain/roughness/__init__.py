"""Roughness: slopes over distances, and random surfaces that have these slopes."""
