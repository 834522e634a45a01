"""Measure a disparity map against the truth of its pair."""
