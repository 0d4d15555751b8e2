"""Programs made of programs, and their code: derivatives, bounds, double-double, export."""
