"""The layout and the reader of run files, which contain the images and the device readings of a test."""
