"""Learned matchers as torch modules with the official parameter names, so that the official checkpoints load.

Only this package needs torch, and the package is imported only when such a matcher runs.
"""
