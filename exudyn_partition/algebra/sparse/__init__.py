"""Factors of sparse symmetric matrices: order of elimination, factors by fronts, and flexibilities by them."""
