"""Benchmarks of speed and accuracy, started from the repository, as in `python -m benchmarks.speed`."""
