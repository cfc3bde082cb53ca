"""The run file: one schema, and how it is read."""
