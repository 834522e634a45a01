"""Decisions on a lander's workspace from a matcher's depth, and their differences from decisions by the truth."""
