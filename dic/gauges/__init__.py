"""Virtual gauges in a displacement field: extensometers, areas, line cuts and points, read in each image."""
