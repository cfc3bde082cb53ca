"""Simulated rotation stages: the mechanics, and the protocols spoken on the wire."""
