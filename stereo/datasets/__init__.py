"""Stereo data from elsewhere: photographs and other data sets, and predictions by other programs."""
