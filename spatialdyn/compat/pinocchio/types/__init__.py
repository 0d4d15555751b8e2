"""SE3, Motion, Force, Inertia and their kin; arrays and lists that track changes."""
