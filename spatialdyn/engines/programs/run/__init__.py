"""Programs run: tiers, batches, the interpreter, single calls, time loops."""
