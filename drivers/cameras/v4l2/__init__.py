"""Cameras of the Linux kernel (Video4Linux2)."""
