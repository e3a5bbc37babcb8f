"""What is known before a mesh: impacts by Hertz (paper, eq. 30), and the frequencies that they excite (section 5.2)."""
