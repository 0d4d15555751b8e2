"""Which names of Pinocchio are here, what is different on purpose, and how a script is ported."""
