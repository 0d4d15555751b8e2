"""Running programs: tiers, batches, the interpreter, single calls, time loops."""
