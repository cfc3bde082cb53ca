"""Camera driver that uses OpenCV, for cameras that no other driver supports."""
