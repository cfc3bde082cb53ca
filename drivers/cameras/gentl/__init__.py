"""Camera driver for cameras with a GenTL producer of their maker (a .cti file), through Harvesters."""
