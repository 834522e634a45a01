"""Whether Blender's data-blocks are still what was built."""
