"""How contact forces follow from gaps: one file for each formulation."""
