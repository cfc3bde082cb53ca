"""The subcommands of the command `dic`, one module for each."""
