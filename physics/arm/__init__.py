"""The lander's arm: kinematics, reach and collisions."""
