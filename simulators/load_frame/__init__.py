"""A simulated load frame: crosshead and controller, registers, and Modbus on the wire."""
