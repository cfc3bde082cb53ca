"""Compare settings on the user's own images: their noise, resolution and error."""
