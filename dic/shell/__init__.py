"""Code that all commands share: printing, stopping, and checks of output paths."""
