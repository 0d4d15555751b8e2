"""Data: where calls leave their results.

Each call notes what it was given in a Run; a field is computed from the latest Run that fills it when it is first
read. Arrays and lists, once read, are live as in Pinocchio: the next call that fills them changes them in place, and
what is written to them stays until then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import ShapeError
from ..model.library_model import Made, made
from ..model.model import Model
from ..model.serialization_format import Stored, fill, state
from ..types.arguments import ArgumentError, described
from ..types.array_rows import Rows
from ..types.inertia import Inertia
from ..types.motion import Force, Motion
from ..types.se3 import SE3
from .last_call import Run, clock

Array = NDArray[np.float64]

# --- the fields ------------------------------------------------------------------------------------------

_JOINTS = {
    SE3: "oMi liMi iMf",
    Motion: "v a a_gf ov oa oa_gf",
    Force: "f h of oh",
    Inertia: "Ycrb oYcrb",
}
Size = str | int | Callable[[Any], int]
_WIDTH: dict[Any, tuple[int, ...]] = {SE3: (4, 4), Motion: (6,), Force: (6,), Inertia: (10,)}


def _parameters(model: Any) -> int:
    """Ten for each joint below the universe."""
    return 10 * (int(model.njoints) - 1)


# field -> sizes as attributes of a model, numbers or functions of a model, and what shows it: None for an array, a type
# for one value of it, a list of a type (or of None, for vectors and numbers) for a list
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
    **{name: ((), float) for name in ("kinetic_energy", "potential_energy", "mechanical_energy")},
}


def _initial(model: Any, name: str) -> Array:
    """What a field holds before any call: zeros, identities, and masses of -1, as in Pinocchio."""
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


# --- the data --------------------------------------------------------------------------------------------


class Data(Stored):
    """Results of the algorithms for a Model; ``model.createData()`` makes one. One for each thread.

    Fields are those of Pinocchio: ``data.M``, ``data.tau``, ``data.oMi`` ... Scratch of Pinocchio's algorithms is no
    result, and is not here.
    """

    model: Any
    _format = "spatialdyn.compat.pinocchio data 1"

    def __init__(self, model: Any = None) -> None:
        if model is None:
            model = Model()
        own = self.__dict__
        own["model"] = model
        own["_sizes"] = (model.nq, model.nv, model.njoints)
        own["_nframes"] = model.nframes
        own["_runs"] = {}  # kind -> Run
        own["_filling"] = {}  # field -> the runs that fill it
        own["_given"] = {}  # field -> (stamp, array), of fields written whole by a call or by a user
        own["_shown"] = {}  # field -> array, of fields that were read: the next call that fills them has to
        own["_bound"] = {}  # builtins about the arrays of fields, by who made them

    def run_of(self, name: str, model: Any, compiled: Made, shape: tuple[int, ...] | None = None) -> Run:
        """The Run of a kind, to be written. Raises ShapeError if the data was made for a model of another size."""
        sizes = (model.nq, model.nv, model.njoints)
        if sizes != self._sizes:
            raise ShapeError(f"data was made for a model of (nq, nv, njoints) {self._sizes}, expected {sizes}")
        run: Run | None = self._runs.get(name)
        if run is not None and run.made is not compiled and run.made.places is compiled.places:
            run.edited(compiled)
            run.bodies = compiled.given.inertias
            self._bound.clear()
        if run is None or run.made is not compiled or (shape is not None and run.result.shape != shape):
            stamp = 0 if run is None else run.stamp
            run = Run(name, compiled, np.array(model.parents, np.intp), shape)
            run.bodies = compiled.given.inertias
            run.stamp = stamp
            self._runs[name] = run
            self._bound.clear()
            run.show(self._shown, self._refreshed)
            self.__dict__["_filling"] = {
                field: [run for run in self._runs.values() if field in run.kind.fills] for field in FIELDS
            }
        return run

    def check_frames(self, model: Any) -> None:
        """Raise ShapeError if the data was made for a model of another number of frames."""
        if model.nframes != self._nframes:
            raise ShapeError(f"data was made for a model of {self._nframes} frames, expected {model.nframes}")

    def ran(self, run: Run) -> None:
        """Note that a call was made just now."""
        run.stamp = clock()
        if self._shown:
            self.refresh(run)

    def redo(self, run: Run) -> None:
        """Note that a builtin was called just now, and write the fields that it fills and that somebody holds."""
        run.stamp = clock()
        for again in run.again:
            if again() is None:
                self.refresh(run)

    def refresh(self, run: Run) -> None:
        """Write the fields that a call fills and that somebody holds, whatever it was given."""
        for name in [*self._shown]:
            if name in run.kind.fills:
                self._refreshed(run, name)

    def _refreshed(self, run: Run, name: str) -> bool:
        """Write one of them."""
        found, shown = run.kind.fills[name](run), self._shown.get(name)
        if shown is None or found is shown:
            return True
        if np.shape(found) == shown.shape:
            shown[...] = found
        else:  # of no fixed size: a new array when it is next read
            del self._shown[name], self.__dict__[name]
            self._attach()
        return True

    def live(self, name: str) -> Array:
        """The array of a field that calls fill in place from now on."""
        found: Array | None = self._shown.get(name)
        if found is None:
            # a view: it cannot be resized under those that fill it
            found = self._shown[name] = np.array(self.array(name))[...]
            self._attach()
        return found

    def _attach(self) -> None:
        """Tell the runs which fields they have to fill at once."""
        self._bound.clear()
        for run in self._runs.values():
            run.show(self._shown, self._refreshed)

    def put(self, name: str, value: Any) -> None:
        """Fill a field whole; one of no fixed size becomes a new array."""
        shown = self._shown.get(name)
        if shown is not None and shown.shape == np.shape(value):
            shown[...] = value
        else:
            self._given[name] = clock(), np.array(value, float)
            self.__dict__.pop(name, None)
            if self._shown.pop(name, None) is not None:
                self._attach()

    def latest(self, name: str) -> Run | None:
        """The last call that filled a field, if any."""
        found, stamp = None, 0
        for run in self._filling.get(name, ()):
            if run.stamp > stamp:
                found, stamp = run, run.stamp
        return found

    def array(self, name: str) -> Array:
        """A field as an array, to be read only."""
        shown: Array | None = self._shown.get(name)
        if shown is not None:
            return shown
        run, given = self.latest(name), self._given.get(name)
        if run is not None and (given is None or given[0] < run.stamp):
            cached = run.cache.get(name)
            if cached is None or cached[0] != run.stamp:
                cached = run.cache[name] = run.stamp, np.asarray(run.kind.fills[name](run))
            return cached[1]
        return _initial(self.model, name) if given is None else given[1]

    def __getattr__(self, name: str) -> Any:
        if name not in FIELDS:
            raise AttributeError(_missing(name))
        kind = FIELDS[name][1]
        if kind is float:
            return float(self.array(name).ravel()[0])
        x = self.live(name)
        shown = x if kind is None else Rows(x, kind[0]) if isinstance(kind, list) else kind.over(x)
        self.__dict__[name] = shown
        return shown

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in FIELDS:
            self.__dict__[name] = value
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

    def copy(self) -> Data:
        """An equal Data of its own, for the same model."""
        made_ = Data(self.model)
        for name in FIELDS:
            if name in self._shown or name in self._given or self.latest(name) is not None:
                made_._given[name] = clock(), np.array(self.array(name))
        return made_

    def _state(self) -> dict[str, Any]:
        fields = {name: x.tolist() for name, (_, x) in self.copy()._given.items()}
        return {"format": self._format, "model": state(self.model), "fields": fields}

    def _become(self, given: Mapping[str, Any]) -> None:
        """Hold the fields of a state and nothing else; its model is made anew unless it is this one's."""
        if state(self.model) != given["model"]:
            model = Model()
            fill(model, given["model"])
            self.__dict__.clear()
            Data.__init__(self, model)
        self.__dict__.update(_runs={}, _filling={}, _given={}, _bound={})
        for name, x in self._shown.items():
            if name not in given["fields"]:
                x[...] = _initial(self.model, name)
        for name, listed in given["fields"].items():
            x = np.array(listed, float)
            self.put(name, x if x.size else x.reshape(_initial(self.model, name).shape))

    __copy__ = copy

    def __deepcopy__(self, memo: Any) -> Data:
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        fields = {name: x for name, (_, x) in self.copy()._given.items()}
        return _restored, (self.model, fields)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Data) and all(
            np.array_equal(self.array(name), other.array(name), equal_nan=True) for name in FIELDS
        )

    __hash__ = object.__hash__

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *FIELDS})


def _restored(model: Any, fields: dict[str, Array]) -> Data:
    data = Data(model)
    for name, x in fields.items():
        data.put(name, x)
    return data


SCRATCH = """
    B Fcrb Ivx Yaba a_in constraint_chol contact_chol dAdq dAdv dac_da dac_dq dac_dv dlambda_dq dlambda_dtau
    dlambda_dv dvc_dq end_idx_v_fromRow idx_vExtended_to_idx_v_fromRow joints lambda_c_prox lastChild
    mimic_parents_fromRow mimic_subtree_joint non_mimic_parents_fromRow nvSubtree nvSubtree_fromRow oK oL oYaba
    oYaba_augmented of_augmented osim parents_fromRow primal_dual_contact_solution primal_rhs_contact q_in
    start_idx_v_fromRow supports_fromRow tau_in v_in vxI
"""


def _missing(name: str) -> str:
    if name in SCRATCH.split():
        return f"data has no {name}: it is scratch of Pinocchio's algorithms, expected one of their results"
    return f"data has no field {name!r}"


def prepared(model: Any, data: Any) -> Made:
    """What the model is to the library. Raises ArgumentError for what is no Model or no Data."""
    if not isinstance(model, Model):
        raise ArgumentError(f"model is {described(model)}, expected a Model")
    if not isinstance(data, Data):
        raise ArgumentError(f"data is {described(data)}, expected a Data")
    return made(model)


def _created(self: Model) -> Data:
    """A Data for the results of the algorithms."""
    return Data(self)


Model.createData = _created
