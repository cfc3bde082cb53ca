"""What a simulated device is met on: ports, lines, TCP servers, and the faults that they can have."""
