"""Corrections for the false strain that appears when a specimen moves out of the grid's plane."""
