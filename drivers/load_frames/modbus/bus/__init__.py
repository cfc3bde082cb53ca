"""Modbus itself: addresses, requests, wires, and the link that keeps them alive."""
