"""What the cameras see: specimen, texture, optics and sensor, rendered without a line of dic."""
