"""The gallery: short programs, each of which shows one thing that the library does.

``spatialdyn example`` lists them, ``spatialdyn example NAME`` or ``python -m spatialdyn.examples.NAME`` runs one,
``spatialdyn example NAME --source`` prints it. Each begins with what one learns and what to look at, and names what it
needs beside NumPy and Numba. Its ``main`` prints, and returns the numbers that the tests check.

"The chapter" is a course's text on Lagrange's and Hamilton's mechanics and the dynamics of joint space, with which this
library began. Its computing exercises and its troubleshooting table are here; where the library's numbers contradict
it, the example says so.
"""
