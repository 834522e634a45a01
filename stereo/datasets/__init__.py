"""Stereo data that was not rendered here: photographs and other data sets, and predictions made elsewhere."""
