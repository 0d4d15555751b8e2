"""Studies: a function of a scene run on any number of random samples, in chunks that any executor takes.

``study`` makes and runs a study; ``chunks`` is a worker's computation of one chunk; ``folder`` has its files and the
manifest that identifies the study; ``pools`` adapts pools that are not executors; ``reductions`` summarize arrays that
are too large to keep.
"""
