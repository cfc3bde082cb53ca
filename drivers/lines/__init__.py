"""Serial and TCP lines to instruments: channels, their addresses, whose turn it is, deadlines of a stop."""
