"""Comparison with other programs: reads their result files, and compares them at the points in common."""
