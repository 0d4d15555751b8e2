"""Data: fields, the calls that fill them, and how a call finds its way to a kernel."""
