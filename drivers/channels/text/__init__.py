"""Driver for instruments that answer with, or send, lines of text: meters, indicators, microcontrollers."""
