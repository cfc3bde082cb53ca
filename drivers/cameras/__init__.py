"""Cameras: what all of them share, and one folder per interface to a camera."""
