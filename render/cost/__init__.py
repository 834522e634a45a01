"""The cost of a render in time, memory and accuracy, and the possible ways of rendering."""
