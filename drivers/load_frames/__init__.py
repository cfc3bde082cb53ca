"""Drivers for tensile load frames, one folder per protocol."""
