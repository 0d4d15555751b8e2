"""The public calls: check the arguments, run an engine, raise errors that name the cause."""
