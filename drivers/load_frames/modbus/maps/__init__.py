"""Register maps of load frames, as TOML files."""
