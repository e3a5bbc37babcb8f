"""Contact with plastic zones beneath the patches."""
