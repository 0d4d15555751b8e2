"""Dynamics under constraints: contacts and impacts."""
