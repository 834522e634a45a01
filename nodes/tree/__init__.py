"""Node trees, written as the formula that they are."""
