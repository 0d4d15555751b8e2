"""Control laws and costs as runs take them: a Spec with values; laws can be added, clipped, held and called.

``simulation`` imports this package. The laws by name, with their paths and gains, and the functions that examine runs
are in ``control``, which imports ``simulation``.
"""
