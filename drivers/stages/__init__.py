"""Rotation stages: what all of them share, and one folder per protocol."""
