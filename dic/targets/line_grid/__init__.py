"""Find a line grid in an image and measure the intersections of its lines."""
