"""Open HDF5 files only after another process has inspected them, because a file may be damaged."""
