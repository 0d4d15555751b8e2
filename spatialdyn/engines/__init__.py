"""Engines that run a recursion: compiled, as a program on SIMD lanes, or on other numbers."""
