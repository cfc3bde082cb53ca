"""Compares the tensile tests of several specimens: values, mean, scatter, outliers, planar anisotropy."""
