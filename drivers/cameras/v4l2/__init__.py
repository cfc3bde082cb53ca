"""Camera driver for the camera interface of the Linux kernel (Video4Linux2, V4L2)."""
