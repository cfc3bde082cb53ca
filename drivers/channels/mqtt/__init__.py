"""Driver for values that other programs publish on an MQTT broker."""
