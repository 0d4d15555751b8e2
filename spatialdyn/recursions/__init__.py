"""The algorithms, one file each, written once as their source prints them.

A recursion takes the table of bodies, a table of scratch and the arrays of one sample, writes its outputs and
returns nothing. It allocates nothing, branches on no value and knows no names, so one source runs in plain
Python, under Numba and on numbers that record, are exact or are symbols. ``SPECS`` gathers what each file
offers; a new file with a ``SPECS`` of its own is a new public call.
"""

from __future__ import annotations

import importlib
import pkgutil

from .spec import Spec

SPECS: dict[str, Spec] = {
    spec.name: spec
    for module in sorted(m.name for m in pkgutil.iter_modules(__path__))
    for spec in getattr(importlib.import_module(f"{__name__}.{module}"), "SPECS", ())
}
