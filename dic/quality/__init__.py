"""The quality of an image for the measurement: speckles, noise, light and focus."""
