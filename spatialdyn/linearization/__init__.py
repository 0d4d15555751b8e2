"""Linear systems near a state: derivatives of steps, also with impulses, and of the equation of motion."""
