"""Streams of camera frames: all frames of a camera in order, and an account of the missing ones."""
