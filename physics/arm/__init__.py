"""The lander's arm: kinematics, reach, collisions, and the shape of the lander."""
