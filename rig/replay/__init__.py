"""Replay a recorded run through the engine, and compare the new run file with the old one."""
