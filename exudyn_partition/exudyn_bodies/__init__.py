"""Partition bodies in an Exudyn model: nodes, objects, markers, joints and carriers (paper, eq. 10, 17, 18).

Exudyn assembles and solves eq. 10 and 18. `joints` adds what its explicit solvers lack.
"""
