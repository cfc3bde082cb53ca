"""Cameras through OpenCV, for cameras without a better driver."""
