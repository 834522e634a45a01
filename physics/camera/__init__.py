"""Lenses, exposure and sensors of a stereo camera."""
