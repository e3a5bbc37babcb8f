"""Linear algebra: ordering, factorisation, Krylov vectors and modes, and linear complementarity."""
