"""How contact forces follow from gaps: one file for each formulation.

The paper's multipliers (eq. 21 to 28) are `lagrange`, for one contact, and `forward_increment`, for all of them. They
need the gaps at the end of a step to be >= 0 (eq. 21), instead of accelerations that are zero (eq. 24).
"""
