"""The subcommands of the command line, one per file: each has ``add``, which adds its arguments to the parser."""
