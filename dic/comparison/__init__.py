"""Reads result files of other correlation programs, and compares them with a measurement of offaxis."""
