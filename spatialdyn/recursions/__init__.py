"""The algorithms, one file each, a folder for each chapter, each written once in the form of its source.

A recursion takes the table of bodies, a table of scratch and the arrays of one sample, writes its outputs in place and
returns nothing. It allocates nothing, branches on no value and knows no names. One source therefore runs in plain
Python, under Numba, and on recording, exact or symbolic numbers. ``SPECS`` gathers the Specs of all files.

To add a public call, write a recursion and add its Spec to the ``SPECS`` of a file here, new or old: ``sd.NAME``, its
help, kernels and programs follow. Then run ``python tests/calls/test_typing.py``, which writes the stub anew. Add an
entry to the table ORACLE of ``tests/recursions/test_dynamics.py``, or name there a test elsewhere. Add a row to
``validate.calls.CALLS`` with Pinocchio's function or none; if none, add an identity to ``validate.identities``.
An array may have any name: add a name that ``validate.states`` lacks as a field there, and a unit that
``tests/recursions/test_covariance.py`` lacks as an entry there. There are few names of ``static`` inputs (row,
placement, reference, classical); describe a further one in ``calls.dynamics`` and ``calls.specs``. Recursions over a
table of constraints or contacts (``constraint_rows``, ``constrained``, ``contact``) are in no SPECS: their calls, in
the package ``constraints``, take the table as second argument. Kernels compile at the first call, which then reports
mistakes in a recursion, most legibly with ``NUMBA_DISABLE_JIT=1``.

A loop until a condition, and a body that not every sample needs, are *regions* (``algebra.regions``)::

    for _ in repeat(12, left, force, velocity):
        if settled(left[0]):
            break
        ...

    for _ in when(speed - least, force):
        ...

The first runs while ``left[0]`` is above 0, at most 12 times; the second runs once if its number is above 0. ``left``,
``force`` and ``velocity`` are *carried*: list all arrays and records of scratch or output that the body writes and that
are read in the body or after it. In a sample that does not need the body their entries stay unchanged. NaN is not above
0: it ends a loop. Plain Python, compiled kernels and exact numbers run the code as written. A program contains the body
once, as a loop over a register of samples that ends when no sample needs it; a finished sample keeps its bits,
whatever the other samples do. Regions nest. In the body of a program the sine of an angle above 1e5, beyond the range
of lanes, is NaN. Derivatives, bounds, double-double and CasADi take no regions: for them loops of at most 16 passes
are recorded pass by pass (``ProgramOptions.straight``), others are refused by name, as all are for symbols.

Three recursions do branch on values. ``aba_square_root`` and ``kkt`` choose pivots: the Spec of the first has
``traceable=False``, the second has no Spec. ``rnea`` adds the forces of ``rnea_off_norm`` if a quaternion of q is off
its unit norm and the table accepts such q; tables of the Pinocchio face do, tables of programs do not.

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
trace, program    to run a recursion once on recording numbers; the resulting list of one model's operations
lane              one of the samples that a program computes side by side in a SIMD register
region            loop of a program, or a body that is skipped: run while any of the samples needs it
carried           of a value that a region changes: an entry of an array or record passed to ``repeat`` or ``when``
regroup           to move inertia from a body to its parent where no result of the Spec changes: shorter programs
pivot             D = S·IA S + armature of a row, IA its articulated inertia: divided by, so it must not be near 0
singular          of a joint whose pivot is at most n eps times its composite inertia: tau determines no acceleration
status            code that a kernel returns for a sample: OK, SHAPE, UNIT, PIVOT or NONFINITE (``engines.compiled``)
static table      table beside that of bodies, one for all samples, such as the constraints': hashed by its content
state of its own  input of a Spec with a start: bristles, an estimate, work; a run carries it from step to step
equation          a scalar condition φ(q) = 0, or J(q) v = 0 without φ; a constraint is one or several
drop              to leave out an equation that depends on others: its force is 0, and its pivot counts as none
rotor             part of a motor that turns on the body before its joint, n times as fast: in every recursion a unit
                  of q̇ has its couple n J e, beside the momentum of the bodies that the joint moves (``rotors``)
mimic, G          joint that follows another, its leader; G maps the model's velocities to the full tree's
through M         the way of calls with pivots for models with mimic joints: form M = Gᵀ M_full G and solve with it
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
