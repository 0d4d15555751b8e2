"""Control: paths to follow, control laws by name and their gains, inverse kinematics, observers, monitors of stability.

It stands above ``simulation``, whose runs it makes and looks at. What a law is to a run, any Spec with values, is in
``laws``, which stands below.
"""
