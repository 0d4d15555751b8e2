"""The subcommands of the command line, one a file: each has ``add``, which puts it into the parser."""
