"""Devices: cameras, rotation stage and load frame, behind the interfaces the rig works with."""
