"""A camera's calibration: from pixels to millimetres on the grid's plane."""
