"""Control: laws and costs that a run takes, laws by name and their gains, paths, inverse kinematics, observers.

A law is any Spec with values (``Control``); ``simulation`` imports this package and records laws into its steps.
"""
