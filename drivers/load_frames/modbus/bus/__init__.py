"""Modbus itself: addresses, requests, wires, and the link to a device."""
