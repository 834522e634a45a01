"""Plans of data sets: from what a plan states to its pairs and their order."""
