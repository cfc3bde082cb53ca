"""Records of testing machines: their tables, units, and how they are joined to images."""
