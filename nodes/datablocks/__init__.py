"""Detects changes of built data-blocks by hand."""
