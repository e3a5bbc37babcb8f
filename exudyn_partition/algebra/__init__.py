"""Linear algebra: factorisation, Krylov vectors and modes, and linear complementarity."""
