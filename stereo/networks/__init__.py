"""Learned matchers as torch modules, with the parameter names of the official ones, so that their checkpoints load.

Nothing outside this package needs torch; nothing imports it before such a matcher runs.
"""
