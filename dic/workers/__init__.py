"""Workers that run functions: threads, processes and other computers, each as a Python executor."""
