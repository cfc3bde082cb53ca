"""Tests of several specimens together: values, mean, scatter, outliers, planar anisotropy."""
