"""From a matcher's depth to decisions on a lander's workspace, and how they differ from those that the truth gives."""
