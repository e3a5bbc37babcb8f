"""What is known before a mesh: impacts by Hertz, and the frequencies that they excite."""
