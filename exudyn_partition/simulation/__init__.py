"""Runs by Exudyn's solvers: steps, checks before, reviews after, and the result."""
