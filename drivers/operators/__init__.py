"""Operators: the people who act at the machine on request."""
