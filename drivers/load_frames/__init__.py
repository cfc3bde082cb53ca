"""Tensile load frames, one folder per protocol."""
