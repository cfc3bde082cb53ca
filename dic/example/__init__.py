"""A small measurement to try at once: images, mask, the machine's record, and the true strains."""
