"""C for a controller's chip: calls, control laws and steps of a scene as one C99 file, with a check to run there."""
