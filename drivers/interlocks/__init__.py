"""Interlocks: readings that must be within bounds before and during a run, such as a door contact."""
