"""Draw calibration targets for printing: the dark areas of a target, and the sheet with its rulers."""
