"""How contact forces follow from gaps: one file for each law.

The paper's multipliers (eq. 21 to 28) are in `explicit_multipliers`. By eq. 21, gaps must be >= 0 at the end of a step.
Accelerations are not set to zero as in eq. 24.
"""
