"""Photographed pairs beside their twins: the same rig over simulated ground, compared by image statistics and by
matchers.
"""
