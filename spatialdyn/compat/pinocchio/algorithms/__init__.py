"""The calls on a Model and its Data, by subject as Pinocchio documents them."""
