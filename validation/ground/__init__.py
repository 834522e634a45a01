"""Statistics of made grounds and rocks, their estimators, and the published numbers that they are compared with."""
