"""Newport ESP301 motion controllers."""
