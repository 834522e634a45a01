"""Fuses stereo and the sparse range points of a LiDAR to one disparity map."""
