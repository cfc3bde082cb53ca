"""Result files, CSV tables and maps."""
