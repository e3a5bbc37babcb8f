"""Two patches that face each other: closest points, contact points and the rows of gaps (paper, eq. 19, 20)."""
