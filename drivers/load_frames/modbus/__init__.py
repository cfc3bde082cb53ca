"""Driver for load frames on Modbus. A register map describes the registers of each machine."""
