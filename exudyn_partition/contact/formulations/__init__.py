"""How contact forces follow from gaps: one file for each law.

The paper's multipliers (eq. 21 to 28) are in `explicit_multipliers`. They need the gaps at the end of a step to be
>= 0 (eq. 21), instead of accelerations that are zero (eq. 24).
"""
