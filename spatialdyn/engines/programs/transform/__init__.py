"""Programs made from other programs, and source code made from programs: derivatives, bounds, double-double, export."""
