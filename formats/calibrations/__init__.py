"""Calibrations of cameras in the files of other programs: readers and writers, one registry."""
