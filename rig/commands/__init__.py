"""The functions behind the subcommands of `rig`, with one module for each subcommand."""
