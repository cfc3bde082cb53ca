"""Drivers for rotation stages: the common part, and one folder per protocol."""
