"""A simulated module with digital inputs and analogue registers on Modbus TCP."""
