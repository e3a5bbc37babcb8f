"""Gaps between moving patches, gaps to rigid surfaces, and the generalised forces of contact."""
