"""The cost of a render in time, memory and accuracy, and the available ways of rendering."""
