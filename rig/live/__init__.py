"""Live gauges of a run: their declaration, the process that measures them, and their values."""
