"""Tools to build node trees."""
