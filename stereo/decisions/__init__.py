"""From a matcher's depth to decisions on a lander's workspace, and their differences from decisions by the truth."""
