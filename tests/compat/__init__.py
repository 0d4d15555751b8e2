"""Tests of the faces of other libraries."""
