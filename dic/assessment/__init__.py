"""Repeat the paper's numerical assessment of the calibration."""
