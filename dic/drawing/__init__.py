"""The page on which a person draws regions, cracks and gauges over an image, in any browser and offline."""
