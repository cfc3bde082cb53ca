"""The subcommands of `dic`, one module each."""
