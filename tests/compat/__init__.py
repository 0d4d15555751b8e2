"""Tests of other libraries' names and conventions."""
