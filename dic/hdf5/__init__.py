"""Open HDF5 files that may be damaged or from strangers, after another process has inspected them."""
