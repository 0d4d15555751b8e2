"""Accuracy against speed: errors and costs of a task on a model, diagnosis and simplification of models."""
