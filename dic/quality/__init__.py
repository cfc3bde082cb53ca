"""Is an image good enough to be measured? Speckles, noise, light and focus."""
