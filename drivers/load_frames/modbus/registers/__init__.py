"""Registers of a load frame by name and unit: the register map, and the device read through it."""
