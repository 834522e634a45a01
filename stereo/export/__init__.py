"""Pairs in the layouts of other data sets."""
