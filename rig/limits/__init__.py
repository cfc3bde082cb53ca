"""The limits of a run: one table from protocol and rig, and the agreement of load and displacement."""
