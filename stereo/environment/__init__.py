"""The evaluator's Python: the packages that it needs, and their installation."""
