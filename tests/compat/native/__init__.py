"""Tests of compat.native."""
