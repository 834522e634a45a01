"""The processes that render a data set, and what they share."""
