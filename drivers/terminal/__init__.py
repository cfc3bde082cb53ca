"""Questions to the person at the terminal, for drivers and for commands."""
