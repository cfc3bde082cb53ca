"""Drivers of devices that measure signals: forces, displacements, temperatures, counters."""
