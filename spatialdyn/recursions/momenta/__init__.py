"""Energy, momentum, Coriolis matrices and Hamilton's equations."""
