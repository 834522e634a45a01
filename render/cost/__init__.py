"""What a render costs in time, memory and accuracy, and which ways of rendering there are."""
