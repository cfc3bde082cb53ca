"""The measurement: images in, calibrated fields and strains out."""
