"""Operators: who is asked to act at the machine."""
