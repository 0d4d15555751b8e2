"""What a motion does with its energy: the ledger of work, passivity, and the fall of a Lyapunov function."""
