"""The virtual rig: all simulated devices and one specimen, for rig files, tests and other programs."""
