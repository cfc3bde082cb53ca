"""Camera drivers: shared modules, and one folder per camera interface."""
