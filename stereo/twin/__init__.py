"""Photographed pairs beside their twins: the same rig over simulated ground, by image statistics and by matchers."""
