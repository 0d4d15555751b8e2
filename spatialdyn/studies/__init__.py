"""Studies: a function of a scene run on any number of random samples, in chunks that any executor takes.

``study`` makes one and runs it; ``chunks`` is what a worker does with one chunk; ``folder`` holds the files that it
leaves, and the manifest that keeps runs apart; ``pools`` serves what is no executor; ``reductions`` are
what is kept of arrays too large to keep.
"""
