"""Operational space: inertia and forces of a frame, tasks in strict order, whole bodies by quadratic programs."""
