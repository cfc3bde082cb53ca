"""Serial and TCP connections to instruments: addresses, channels, order of requests, and stop deadlines."""
