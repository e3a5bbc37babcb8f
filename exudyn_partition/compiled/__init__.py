"""Explicit runs as functions of arrays: a plan and a start give histories, without Exudyn and Python between steps."""
