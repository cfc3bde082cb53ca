"""The run file: its schema and its reader."""
