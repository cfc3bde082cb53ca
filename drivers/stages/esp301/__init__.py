"""Driver for rotation stages on Newport ESP301 motion controllers."""
