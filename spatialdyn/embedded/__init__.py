"""C for a controller's chip: calls, control laws and steps as one C99 file, with what checks it there."""
