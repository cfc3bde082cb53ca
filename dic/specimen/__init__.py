"""Find the specimen in an image: the surface with speckles that is worth measuring."""
