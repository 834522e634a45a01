"""Reflection of light by ice and snow: laws, albedos, texture maps."""
