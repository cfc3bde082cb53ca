"""Simulated rotation stages: the mechanics, and servers for the protocols of two controllers."""
