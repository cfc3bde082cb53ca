"""A simulated load frame: crosshead, controller, registers and Modbus servers."""
