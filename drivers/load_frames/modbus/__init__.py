"""Driver for load frames on Modbus; a register map describes the registers of each machine."""
