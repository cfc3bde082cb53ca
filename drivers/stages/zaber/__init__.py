"""Zaber stages, ASCII protocol."""
