"""Two patches that face each other: places, closest points, integration points and the rows that they make."""
