"""Gaps between moving patches or to rigid surfaces, and what forces on them do."""
