"""The evaluator's Python: what it needs, and how it is installed."""
