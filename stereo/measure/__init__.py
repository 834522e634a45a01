"""Measuring a disparity map against a pair's truth."""
