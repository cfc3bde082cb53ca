"""Access to the registers of a load frame by name and in physical units, with a register map."""
