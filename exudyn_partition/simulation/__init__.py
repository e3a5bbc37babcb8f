"""Runs by Exudyn's solvers: steps, checks before, and the result; `reviews` look at runs afterwards."""
