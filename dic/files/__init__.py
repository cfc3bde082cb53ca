"""Read files that do not exceed a given size, and write files completely or not at all."""
