"""Regions of interest drawn by hand: reads polygons, holes and cracks from files, and makes masks of them."""
