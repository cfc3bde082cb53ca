"""Images: read, judged as files, interpolated; regions of interest."""
