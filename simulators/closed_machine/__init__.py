"""A testing machine that runs a program of its own, and the box at its voltage and trigger outputs."""
