"""Read, check and interpolate images, and read regions of interest."""
