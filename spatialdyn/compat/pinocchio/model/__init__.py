"""Models, joints, and how they are read, stored, joined and reduced."""
