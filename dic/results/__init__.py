"""The output of results: HDF5 result files, CSV tables, and maps as pictures."""
