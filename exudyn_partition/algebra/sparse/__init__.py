"""Factors of sparse symmetric matrices: order of elimination, and factors by fronts."""
