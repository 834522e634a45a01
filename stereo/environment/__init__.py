"""The Python of the evaluator: the packages that it needs, and their installation."""
