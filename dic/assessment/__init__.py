"""Repeat the numerical assessment of the calibration from the paper of Helm and Deaner."""
