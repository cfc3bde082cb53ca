"""Reads the tables that testing machines record, and joins their readings to images."""
