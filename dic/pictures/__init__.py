"""Pictures of measured fields: maps over the image, contact sheets of a series, and their scales."""
