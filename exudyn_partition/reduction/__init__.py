"""From FE model to reduced body: unit loads, Krylov vectors, bases, tolerance, and fields recovered from results."""
