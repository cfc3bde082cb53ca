"""What a test does: the protocol file, its steps, and the criterion of plasticity."""
