"""The code of a call on one table, which plans share: a program, or the table kernel."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....recursions.spec import Spec
from ... import object_layout as layout
from ...compiled import entries


class CallCode:
    """The code of a call: three words ``(entry, context, left)`` at ``address``, see ``call_words.PLAN``.

    program  a TieredProgram; None for the table kernel
    """

    def __init__(self, spec: Spec, table: Any, program: Any = None) -> None:
        """Of a call on a table of bodies, which has an ``address``."""
        self.spec, self.program, self._table = spec, program, table
        self._context = entries.context_of(table)
        self._words = np.zeros(3, np.int64)
        self._alive: list[Any] = []
        self.address = self._words.ctypes.data
        self._take()

    def _take(self) -> None:
        if self.program is None:
            self._context[0] = self._table.address
            self._words[:] = entries.table_entry(self.spec).words(self._context.ctypes.data)
        else:
            self._words[:], alive = self.program.single()
            self._alive.append(alive)

    def renew(self) -> bool:
        """Switch to faster code if there is some by now; returns whether there is."""
        before = self._words.tolist()
        if self.program is None or layout.words_at(before[2], 1)[0] == 0:
            self._take()
        return self._words.tolist() != before

    def use_table(self) -> None:
        """Run the table kernel from now on."""
        self.program = None
        self._take()
