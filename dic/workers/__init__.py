"""Threads, processes and other computers that run functions, each kind as an executor of Python."""
