"""The processing steps from images or a run to results, in their order."""
