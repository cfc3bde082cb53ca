"""The virtual rig: all simulated devices around one specimen, for rig files, tests and other programs."""
