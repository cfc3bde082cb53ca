"""The camera as geometry describes it: projection, lens distortion, and how they are fitted."""
