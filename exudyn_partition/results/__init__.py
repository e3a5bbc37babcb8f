"""Histories of force and velocity, and their comparison."""
