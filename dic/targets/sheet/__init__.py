"""Draws calibration targets for printing: what is dark on them, and the sheet with its rulers."""
