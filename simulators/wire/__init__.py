"""Ports, lines and TCP servers through which clients reach a simulated device, and faults of devices."""
