"""The protocol of a test: the protocol file, the steps, and the criterion for plastic deformation."""
