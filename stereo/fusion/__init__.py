"""Stereo and the sparse range points of a LiDAR in one disparity map."""
