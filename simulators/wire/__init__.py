"""Ports, lines and TCP servers on which a simulated device is reached, and their faults."""
