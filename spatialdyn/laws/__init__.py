"""What a control law or a cost is to a run: a Spec with values, and how laws add, are clipped, held and called.

``simulation`` takes these, so they stand below it. The laws by name, with their paths and gains, and what looks at runs
stand above it, in ``control``.
"""
