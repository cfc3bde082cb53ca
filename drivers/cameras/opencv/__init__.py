"""Cameras through OpenCV, where nothing better reaches them."""
