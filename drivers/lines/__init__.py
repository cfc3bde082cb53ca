"""Serial and TCP lines to instruments: channels, addresses, order of requests, deadlines of a stop."""
