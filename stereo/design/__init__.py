"""Studies of sensor suites on ray-traced grounds: their decisions and costs."""
