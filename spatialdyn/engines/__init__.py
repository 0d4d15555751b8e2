"""The ways of running a recursion."""
