"""Regions of interest drawn by hand: polygons, holes and cracks, their files, and the mask they give."""
