"""Material properties from the record of a tensile test: elastic slope, yield, strength, hardening."""
