"""Linear systems near a state: derivatives of steps and of the equation of motion, those of impulses among them."""
