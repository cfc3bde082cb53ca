"""Gauges in a measured field: extensometers, areas, cuts and points, with one reading per image."""
