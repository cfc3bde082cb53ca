"""The pinhole model of a camera: projection, lens distortion, and the fit of all parameters."""
