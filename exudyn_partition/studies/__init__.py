"""Studies of many runs: restitution over speed, angle, place and friction."""
