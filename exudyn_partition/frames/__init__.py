"""Motion of a reduced body in space: inertial and floating frame, mean axes, inertia forces (paper, eq. 1 to 9).

`kinematics` is the protocol; `inertial` and `floating` implement it. `inertia_forces` has the equations of motion.
"""
