"""The paper's numerical assessment of the calibration, repeated."""
