"""The algorithms, one file each, a folder for each chapter, written once as their source prints them.

A recursion takes the table of bodies, a table of scratch and the arrays of one sample, writes its outputs in place and
returns nothing. It allocates nothing, branches on no value and knows no names, so one source runs in plain Python,
under Numba and on numbers that record, are exact or are symbols. ``SPECS`` gathers the Specs of all files.

A new public call is a recursion and its Spec in the ``SPECS`` of a file here, new or old: ``sd.NAME``, its help,
kernels and programs follow. Then ``python tests/calls/test_typing.py`` writes the stub anew, and the call needs an
entry in the table ORACLE of ``tests/recursions/test_dynamics.py``, or a test elsewhere that is named there, and a row
in ``validate.calls.CALLS``, which names Pinocchio's function or none; if none, an identity in ``validate.identities``.
An array may have any name: one that ``validate.states`` lacks is a field there, one of a unit that
``tests/recursions/test_covariance.py`` lacks an entry there. The names of ``static`` inputs are few (row, placement,
reference, classical), and a further one needs its words in ``calls.dynamics`` and ``calls.specs``. Recursions over a
table of constraints or contacts (``constraint_rows``, ``constrained``, ``contact``) are in no SPECS: their calls, in
the package ``constraints``, take the table as second argument. Kernels compile at the first call: a mistake in a
recursion shows then, most legibly with ``NUMBA_DISABLE_JIT=1``.

A loop until a condition, and a body that not every sample needs, are *regions* (``algebra.regions``)::

    for _ in repeat(12, left, force, velocity):
        if settled(left[0]):
            break
        ...

    for _ in when(speed - least, force):
        ...

The first runs while ``left[0]`` is above 0, at most 12 times, and the second once if its number is. ``left``, ``force``
and ``velocity`` are *carried*: all arrays and records of scratch or output that the body writes and that it or what
follows reads, entry by entry what they were where a sample does not need the body. NaN is not above 0: it ends a loop.
Plain Python, compiled kernels and exact numbers run what is written. A program has the body once, as a loop over a
register of samples that ends when none needs it, and a sample that is done keeps its bits: it does not see the others.
Regions nest. In a body of a program an angle above 1e5, which lanes do not reach, has no sine: it is NaN. Derivatives,
bounds, double-double and symbols refuse programs that have regions, by name.

Three recursions do branch on values. ``aba_square_root`` and ``kkt`` choose pivots: the Spec of the one says that it
does not trace, the other has none. ``rnea`` adds the forces of ``rnea_off_norm`` if a quaternion of q is off its unit
norm and the table accepts such q, as tables of the Pinocchio face do and those of programs do not.

Words that any file of the package may use:

================  ======================================================================================================
table, row        table of bodies (``bodies.table``): a structured array, one row per degree of freedom; row 0 is the
                  world, a parent's row comes before its children's, and row i belongs to velocity v[i - 1]
subspace S        motion of a row at unit rate, constant in its body; the joint's velocity is Σ S q̇ over its rows
joint             one or more rows, the body on the last; numbered depth first, joint 0 is the world
coordinate        an entry of q, nq in all; a quaternion has four, a (cos, sin) pair two
freedom           an entry of v, nv in all: a rate of q, or a twist of the body in its own frame
configuration     q, a point of a Lie group: ``integrate`` takes the place of a sum, ``difference`` of a difference
outward, inward   a loop over the rows from the world to the tips, or back
scratch, work     table of intermediate results, a row for each of bodies; a file's WORK lists its fields
Spec              a public call as data: recursion, WORK, inputs and output with shapes and units, source (``spec``)
sample, batch     the inputs of one evaluation; many of them, stacked on leading axes
engine            a way of running every recursion: Numba, programs, exact numbers, symbols
kernel            compiled function that an engine makes of a recursion, for one sample or a batch
table kernel      kernel that reads any model's table at run time: no compiling per model
trace, program    to run a recursion once on numbers that record; the list of one model's operations that results
lane              one of the samples that a program computes side by side in a SIMD register
region            loop of a program, or a body that is skipped: run while any of the samples needs it
carried           of a value that a region changes: an entry of what ``repeat`` or ``when`` is given
regroup           to move inertia from a body to its parent where no result of the Spec changes: shorter programs
pivot             D = S·IA S + armature of a row, IA its articulated inertia: divided by, so it must not be near 0
singular          of a joint whose pivot is at most n eps times its composite inertia: no acceleration follows from tau
status            what a kernel reports of a sample: OK, SHAPE, UNIT, PIVOT or NONFINITE (``engines.compiled``)
static table      table beside that of bodies, one for all samples, such as the constraints': hashed by its content
state of its own  input of a Spec with a start: bristles, an estimate, work; a run carries it from step to step
equation          a scalar condition φ(q) = 0, or J(q) v = 0 without φ; a constraint is one or several
drop              to leave out an equation that depends on others: its force is 0, and its pivot counts as none
rotor             part of a motor that turns on the body before its joint, n times as fast: a unit of q̇ has its couple
                  n J e in every recursion, beside the momentum of what the joint moves (``rotors``)
mimic, G          joint that follows another, its leader; G maps the model's velocities to the full tree's
through M         what calls do in place of a recursion with pivots on models with mimic joints: M = Gᵀ M_full G, solved
stamp             hash of all sources that are compiled, in every cache key: an edit never meets an old kernel
face              ``compat.pinocchio``: the same library under Pinocchio's names and conventions
================  ======================================================================================================
"""

from __future__ import annotations

import importlib
import pkgutil

from .mimic import REDUCTION as REDUCTION
from .spec import Spec

SPECS: dict[str, Spec] = {
    spec.name: spec
    for module in sorted(
        (m.name for m in pkgutil.walk_packages(__path__, f"{__name__}.")), key=lambda name: name.rpartition(".")[2]
    )
    for spec in getattr(importlib.import_module(module), "SPECS", ())
}
