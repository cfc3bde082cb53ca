"""What the subcommands of rig do, one module each."""
