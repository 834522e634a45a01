"""Learned matchers as torch modules with the official parameter names, so that the official checkpoints load.

Nothing outside this package needs torch; nothing imports it before such a matcher runs.
"""
