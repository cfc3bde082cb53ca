"""Render the images of the simulated cameras: specimen, texture, optics and sensor, without code of `dic`."""
