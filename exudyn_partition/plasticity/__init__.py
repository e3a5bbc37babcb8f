"""Plastic zones of bodies: the flow rule, the elements that may yield, and the flexibility of their nodes."""
