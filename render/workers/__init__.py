"""The processes that render a data set, and the files that they share."""
