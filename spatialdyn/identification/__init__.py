"""From a recorded motion to the parameters of a model, with what the recording does not tell."""
