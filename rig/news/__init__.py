"""News of a run for people and other programs: events, a heartbeat, one message at the end, and HTTP."""
