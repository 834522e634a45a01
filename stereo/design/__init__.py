"""What a suite of sensors decides on grounds by rays, and what it costs."""
