"""The layout and the reader of run files. A run file holds the images and the device readings of a test."""
