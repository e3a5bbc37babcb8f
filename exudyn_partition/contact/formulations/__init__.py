"""How contact forces follow from gaps: one file for each law.

The paper's multipliers (eq. 21 to 28) are in `explicit_multipliers`. They require gaps >= 0 at the end of a step (eq.
21). They do not set accelerations to zero (eq. 24).
"""
