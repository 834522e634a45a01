"""Builders of the ground and its rocks."""
