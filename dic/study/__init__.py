"""Compares the noise, resolution and error of many settings on the user's own images."""
