"""Functions that all commands share: print messages, show progress, stop, and check output paths."""
