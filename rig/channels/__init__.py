"""Measured channels of a run: their times on the rig's clock, their newest values, and their record."""
