"""Load frames on Modbus, described by a register map."""
