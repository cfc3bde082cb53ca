"""Execute the steps of a test, and bring the rig to a safe state at the end."""
