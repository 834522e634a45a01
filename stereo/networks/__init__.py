"""Learned matchers as torch modules with the official parameter names, so that the official checkpoints load.

This package needs torch, and is imported only when such a matcher runs or is trained.
"""
