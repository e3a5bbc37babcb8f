"""Motion of a reduced body in space: the inertial frame, the floating frame, mean axes and inertia forces."""
