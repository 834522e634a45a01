"""Plans of data sets: from the text of a plan to its pairs and their order."""
