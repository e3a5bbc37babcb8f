"""From FE model to reduced body: bases T (paper, eq. 13, 15), reduced matrices (eq. 14, 16), tolerance, recovery.

`basis` makes the columns of T, `reduction` the reduced matrices, and `body` holds both. `loads` has loads of the FE
model that bases answer; generalised forces in a run are in `frames`.
"""
