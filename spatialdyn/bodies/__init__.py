"""The table of bodies: its columns, the joint kinds, and how a joint is placed and moved."""
