"""The processing of images or of a run file: calibrate, correlate, compute strain, correct, write files."""
