"""Pinocchio's names and their status here, the differences on purpose, the check of a script."""
