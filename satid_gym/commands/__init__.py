"""Command `satid` and its subcommands."""
