"""Camera driver for GigE Vision and USB3 Vision cameras, through the Aravis library."""
