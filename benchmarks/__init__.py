"""Measures of speed and accuracy; run them from the repository as `python -m benchmarks.speed`."""
