"""Voltage inputs of National Instruments' devices, read through their maker's library NI-DAQmx."""
