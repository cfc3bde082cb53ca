"""The guardian: a separate process that stops the machines if the process of a run dies or hangs."""
