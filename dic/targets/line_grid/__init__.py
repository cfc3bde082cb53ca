"""Detection of a line grid in an image, and measurement of the intersections of its lines."""
