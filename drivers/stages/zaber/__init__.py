"""Driver for Zaber rotation stages with the Zaber ASCII protocol."""
