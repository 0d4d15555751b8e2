"""Data: the results of calls.

Each call records its inputs in a Run; a field is computed at its first read, from the latest Run that fills it. From
then on its array is held, as in Pinocchio: the next call that fills the field writes it in place, and what the caller
writes into it stays until then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ....errors import ShapeError
from ...native.recorded_calls import clock
from ..model.library_model import LibraryModel, library_model
from ..model.model import Model
from ..model.serialization_format import Stored, fill, state
from ..types.arguments import OMITTED, ArgumentError, Array, described, expected
from ..types.bases import Copied, Registered
from ..types.inertia import Inertia
from ..types.motion import Force, Motion
from ..types.se3 import SE3
from ..types.tracked_list import Rows
from .run import Assigned, Run

__all__ = ["Data"]

# --- the fields ------------------------------------------------------------------------------------------

_JOINTS = {SE3: "oMi liMi iMf", Motion: "v a a_gf ov oa oa_gf", Force: "f h of oh", Inertia: "Ycrb oYcrb"}
Size = str | int | Callable[[Any], int]
_WIDTH: dict[Any, tuple[int, ...]] = {SE3: (4, 4), Motion: (6,), Force: (6,), Inertia: (10,)}


def _parameters(model: Model) -> int:
    """Ten for each joint below the universe."""
    return 10 * (int(model.njoints) - 1)


# field -> sizes (attributes of a model, numbers, or functions of a model), and the type that views its array: None for
# a plain array, a type for one value of it, [a type] for a list of values, [None] for a list of vectors or numbers
FIELDS: dict[str, tuple[tuple[Size, ...], Any]] = {
    **{name: (("njoints", *_WIDTH[kind]), [kind]) for kind, names in _JOINTS.items() for name in names.split()},
    "oMf": (("nframes", 4, 4), [SE3]),
    **{name: (("njoints", 3), [None]) for name in ("com", "vcom", "acom")},
    "mass": (("njoints",), [None]),
    **{name: ((6,), Force) for name in ("hg", "dhg")},
    "Ig": ((10,), Inertia),
    **{name: (("nv",), None) for name in ("tau", "nle", "g", "ddq", "dq_after")},
    **{name: (("nv", "nv"), None) for name in ("M", "Minv", "C", "dtau_dq", "dtau_dv", "ddq_dq", "ddq_dv", "ddq_dtau")},
    **{name: ((6, "nv"), None) for name in ("J", "dJ", "Ag", "dAg", "dHdq", "dFdq", "dFdv", "dFda")},
    "Jcom": ((3, "nv"), None),
    "U": (("nv", "nv"), None),
    "D": (("nv",), None),
    "jointTorqueRegressor": (("nv", _parameters), None),
    "kineticEnergyRegressor": ((_parameters,), None),
    "potentialEnergyRegressor": ((_parameters,), None),
    "staticRegressor": ((3, lambda model: 4 * (model.njoints - 1)), None),
    **{name: ((0,), None) for name in ("lambda_c", "impulse_c")},
    **{name: ((0, "nv"), None) for name in ("dlambda_dq", "dlambda_dv", "dlambda_dtau")},
    **{name: ((), float) for name in ("kinetic_energy", "potential_energy", "mechanical_energy")},
}


def _initial(model: Model, name: str) -> Array:
    """A field before any call: zeros, identity poses, masses of -1, as in Pinocchio."""
    sizes, kind = FIELDS[name]
    x = np.zeros([getattr(model, n) if isinstance(n, str) else n if isinstance(n, int) else n(model) for n in sizes])
    if kind == [SE3]:
        x[:] = np.eye(4)
    elif name == "mass":
        x[:] = -1.0
    elif name == "a_gf":
        x[:, :3] = -model.gravity.linear
        x[1:] = 0.0
    return x


def assigned(name: str) -> str:
    """The key of a field that was assigned among ``_runs``: "nle" is a kind of call too."""
    return f"{name} ="


class Data(Stored, Registered, Copied):
    """Results of the algorithms for a Model; ``model.createData()`` makes one. One for each thread.

    Fields are those of Pinocchio: ``data.M``, ``data.tau``, ``data.oMi`` ... but for the scratch of its algorithms.

    Two records: ``_runs``, the stamped sources of all fields, which are the last calls by kind and arrays that the user
    assigned by field; and ``_held``, the arrays of fields that were read, which calls write in place. The rest follows
    from them: ``_bound``, builtins on these arrays, and of the latest Runs, by key; ``_sources``, those of a field;
    ``_latest``, the Runs that getters of Jacobians read, of which ``_noted`` is the last.
    """

    contacts: Any = None  # of the last initConstraintDynamics or constraintDynamics, with its ProximalSettings
    _factors: Any = None, None, 0  # those of ``constraint_chol``, the contacts and the time that they are of
    # each call reads these: a slot is faster to read than a __dict__ that was written to
    __slots__ = ("_bound", "_held", "_latest", "_nframes", "_noted", "_runs", "_sizes", "_sources", "model")
    _format = "spatialdyn.compat.pinocchio data 1"

    def __init__(self, model: Model = OMITTED) -> None:
        self.model = model = Model() if model is OMITTED else expected(model, Model, "model")
        self._sizes, self._nframes = (model.nq, model.nv, model.njoints), model.nframes
        self._runs: dict[str, Run] = {}  # by kind, or by the field that was assigned
        self._sources: dict[str, list[Run]] = {}
        self._held: dict[str, Array] = {}
        self._bound: dict[Any, Any] = {}
        self._latest: dict[str, Run] = {}
        self._noted: Run | None = None

    def run_of(self, name: str, library: LibraryModel, shape: tuple[int, ...] | None = None) -> Run:
        """The Run of a kind for the model that ``library_of`` checked, new if the model changed."""
        run: Run | None = self._runs.get(name)
        if run is None or run.library is not library or (shape is not None and run.result.shape != shape):
            stamp = 0 if run is None else run.stamp
            run = self._runs[name] = Run(name, library, shape, Data.note_latest)
            run.stamp = stamp
            self._unbind()
            self._sources.clear()
            run.hold(self._held, self._recompute)
        return run

    def check_sizes(self, model: Model) -> None:
        """Raise ShapeError if the data was made for a model of another size."""
        sizes = (model.nq, model.nv, model.njoints)
        if sizes != self._sizes:
            raise ShapeError(f"data was made for a model of (nq, nv, njoints) {self._sizes}, expected {sizes}")

    def check_frames(self, model: Model) -> None:
        """Raise ShapeError if the data was made for a model of another number of frames."""
        if model.nframes != self._nframes:
            raise ShapeError(f"data was made for a model of {self._nframes} frames, expected {model.nframes}")

    def note_call(self, run: Run, forces: Array | None = None) -> None:
        """Stamp a Run that was computed just now, with such forces, and recompute the held fields that it fills."""
        run.stamp = clock()
        run.forces = run.stamp, forces
        self.note_latest(run)
        if self._held:
            self.recompute_held(run)

    def note_builtin_call(self, run: Run) -> None:
        """Note a Run whose builtin was called just now, and recompute the held fields by their builtins."""
        if run.after is not None and self._noted is not run:
            self.note_latest(run)
        if run.recompute is not None and run.recompute() is None:
            self.recompute_held(run)

    def note_latest(self, run: Run) -> None:
        """Note a Run as the one that getters of Jacobians read."""
        getters, latest = run.kind.getters, self._latest
        for name in getters:
            before = latest.get(name)
            if before is not run:
                latest[name] = run
                for key in () if before is None else before.bound.get(name, ()):
                    self._bound.pop(key, None)
                self._bound.update(run.bound.get(name, ()))
        if getters and self._noted is not run:  # an attribute of Data takes long to write
            self._noted = run

    def bind_latest(self, name: str, run: Run, made: Mapping[str, Any]) -> None:
        """Have builtins about the inputs of a Run for as long as it is the one that a getter reads."""
        run.bound.setdefault(name, {}).update(made)
        if self._latest.get(name) is run:
            self._bound.update(made)

    def recompute_held(self, run: Run) -> None:
        """Recompute the held fields that a Run fills by their recipes."""
        for name in [*self._held]:
            if name in run.kind.fills:
                self._recompute(run, name)

    def _recompute(self, run: Run, name: str) -> bool:
        """Recompute one held field in place."""
        found, held = run.kind.fills[name](run), self._held.get(name)
        if held is None or found is held:
            return True
        if np.shape(found) == held.shape:
            held[...] = found
        else:  # its size changed: the next read makes a new array
            self._release(name)
        return True

    def _release(self, name: str) -> None:
        """Hold a field no longer."""
        self.__dict__.pop(name, None)
        if self._held.pop(name, None) is not None:
            self._bind_held()

    def hold(self, name: str) -> Array:
        """The held array of a field, which calls write in place from now on."""
        found: Array | None = self._held.get(name)
        if found is None:
            # a view cannot be resized, so builtins may keep its address
            found = self._held[name] = np.array(self.array(name))[...]
            self._bind_held()
        return found

    def _bind_held(self) -> None:
        """Have every Run write the held fields; builtins on other arrays are dropped."""
        self._unbind()
        for run in self._runs.values():
            run.hold(self._held, self._recompute)

    def _unbind(self) -> None:
        """Drop the builtins but those about the inputs of the latest Runs, which are on no held array."""
        self._bound.clear()
        for name, run in self._latest.items():
            self._bound.update(run.bound.get(name, ()))

    def put(self, name: str, value: Any) -> None:
        """Assign a field whole: in place if its array is held and of that shape, else as a new array."""
        held = self._held.get(name)
        if held is not None and held.shape == np.shape(value):
            held[...] = value
        else:
            self._assign(name, np.array(value, float, order="C"))
            self._release(name)

    def _assign(self, name: str, x: Array) -> None:
        """Make an array the source of a field that is not held."""
        before: Any = self._runs.get(assigned(name))
        if before is None:
            self._runs[assigned(name)] = Assigned(name, x)
            self._sources.pop(name, None)
        else:
            before.assign(name, x)

    def latest(self, name: str, of_call: bool = False) -> Run | None:
        """The latest source of a field, if any; ``of_call``: the latest call that recorded its inputs."""
        sources = self._sources.get(name)
        if sources is None:
            sources = self._sources[name] = [run for run in self._runs.values() if name in run.kind.fills]
        found, stamp = None, 0
        for run in sources:
            then = run.stamp
            if then > stamp and (not of_call or run.q is not None):
                found, stamp = run, then
        return found

    def array(self, name: str) -> Array:
        """A field as an array that the caller must not write."""
        held: Array | None = self._held.get(name)
        if held is not None:
            return held
        run = self.latest(name)
        if run is None:
            return _initial(self.model, name)
        cached = run.cache.get(name)
        if cached is None or cached[0] != run.stamp:
            cached = run.cache[name] = run.stamp, np.asarray(run.kind.fills[name](run))
        return cached[1]

    @property
    def constraint_chol(self) -> Any:
        """The ConstraintCholeskyDecomposition of the contacts of the last constraintDynamics, one until the next."""
        run = self._runs.get("contacts")
        contacts, stamp = self.contacts, 0 if run is None else run.stamp
        found, of_contacts, then = self._factors
        if found is None or of_contacts is not contacts or then != stamp:
            found = Registered.classes["ConstraintCholeskyDecomposition"].of(self)
            self._factors = found, contacts, stamp
        return found

    contact_chol = constraint_chol

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in FIELDS:
            object.__setattr__(self, name, value)
            return
        kind = FIELDS[name][1]
        if kind is float:
            self.put(name, float(value))
        elif isinstance(kind, list):
            getattr(self, name).write(value)
        elif kind is None:
            self.put(name, np.asarray(value, float))
        else:
            getattr(self, name)._x[...] = value._x

    def _written(self) -> dict[str, Array]:
        """Copies of the fields that were computed, assigned or read."""
        names = {name for run in self._runs.values() if run.stamp for name in run.kind.fills} | {*self._held}
        return {name: np.array(self.array(name)) for name in FIELDS if name in names}

    def copy(self) -> Data:
        """An independent copy, for the same model."""
        return _restored(self.model, self._written())

    def _state(self) -> dict[str, Any]:
        fields = {name: x.tolist() for name, x in self._written().items()}
        return {"format": self._format, "model": state(self.model), "fields": fields}

    def _become(self, given: Mapping[str, Any]) -> None:
        """Take over the fields of a state; the model is read too unless it equals this one's."""
        if state(self.model) != given["model"]:
            model = Model()
            fill(model, given["model"])
            self.__dict__.clear()
            Data.__init__(self, model)
        for book in (self._runs, self._bound, self._sources, self._latest):
            book.clear()
        self._noted = None
        for name, x in self._held.items():
            if name not in given["fields"]:
                x[...] = _initial(self.model, name)
        for name, listed in given["fields"].items():
            x = np.array(listed, float)
            self.put(name, x if x.size else x.reshape(_initial(self.model, name).shape))

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.model, self._written())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Data) and all(
            np.array_equal(self.array(name), other.array(name), equal_nan=True) for name in FIELDS
        )

    __hash__ = object.__hash__


class Field:
    """A field of Data, computed at its first read: its view replaces this descriptor in the Data. Of scratch, none."""

    def __init__(self, name: str) -> None:
        self.name, self.__doc__ = name, f"Field {name} of the results."

    def __get__(self, data: Data | None, kind: Any = None) -> Any:
        if self.name not in FIELDS:  # a __getattr__ of Data would slow every read of an attribute
            raise AttributeError(
                f"data has no {self.name}: it is scratch of Pinocchio's algorithms, expected one of their results"
            )
        if data is None:
            return self
        kind = FIELDS[self.name][1]
        if kind is float:
            return float(data.array(self.name).ravel()[0])
        x = data.hold(self.name)
        view = x if kind is None else Rows(x, kind[0]) if isinstance(kind, list) else kind.over(x)
        data.__dict__[self.name] = view
        return view


SCRATCH = """
    B Fcrb Ivx Yaba a_in dAdq dAdv dac_da dac_dq dac_dv dvc_dq
    end_idx_v_fromRow idx_vExtended_to_idx_v_fromRow joints lambda_c_prox lastChild
    mimic_parents_fromRow mimic_subtree_joint non_mimic_parents_fromRow nvSubtree nvSubtree_fromRow oK oL oYaba
    oYaba_augmented of_augmented osim parents_fromRow primal_dual_contact_solution primal_rhs_contact q_in
    start_idx_v_fromRow supports_fromRow tau_in v_in vxI
"""
for _name in (*FIELDS, *SCRATCH.split()):
    setattr(Data, _name, Field(_name))


def _restored(model: Model, fields: dict[str, Array]) -> Data:
    data = Data(model)
    data._runs.update((assigned(name), Assigned(name, x)) for name, x in fields.items())
    return data


def library_of(model: Model, data: Data) -> LibraryModel:
    """The LibraryModel of a Model, both arguments checked.

    Raises ArgumentError for what is no Model or no Data, ShapeError for data made for a model of another size.
    """
    if not isinstance(model, Model):
        raise ArgumentError(f"model is {described(model)}, expected a Model")
    if not isinstance(data, Data):
        raise ArgumentError(f"data is {described(data)}, expected a Data")
    data.check_sizes(model)
    return library_model(model)
