"""Accuracy against speed: what a model and a task cost in digits and in time, and what a scene can do without."""
