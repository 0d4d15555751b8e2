"""Numbers, vectors and spatial algebra (RBDA ch. 2): what recursions are written in."""
