"""Motion under constraints: contacts that hold, and impacts."""
