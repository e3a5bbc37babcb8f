"""Reviews of a run: each is a function of the run, and returns findings, which one function tells."""
