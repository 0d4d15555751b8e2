"""M, C, g, energies and Hamilton's equations of a robot in closed form.

``SymbolicManipulator`` runs the recursions of the numerical calls, ``recursions.SPECS``, on exact numbers and symbols
(``engines.numbers.symbolic``), which gives the formulas that they compute. It differentiates results by q.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies import kinds
from ..calls.arguments import as_word, check_model, reference_code
from ..engines.numbers import symbolic as engine
from ..errors import ModelError, SpatialDynError, literal
from ..model.model import Frame, Model
from ..recursions import SPECS
from ..recursions.spec import Argument, Q, shape_in
from ..urdf.load import load_urdf
from ..waiting import watch
from . import printing
from .exact_model import exact_robot, exact_table
from .symbolic_matrices import (
    NumberArray,
    adjugate_and_determinant,
    christoffel_from_gradient,
    coriolis_from_christoffel,
    gradient,
)
from .symbolic_parameters import as_expression, chosen_values, meanings

Expr = Any  # sympy.Expr
Matrix = Any  # sympy.ImmutableMatrix

ROUTES = ("recursion", "derivatives")
LARGEST = 4  # largest number of freedoms for which M is inverted in closed form
LONGEST = 300_000  # products of terms per quantity: up to 30 s of arithmetic
# quantity -> method, arguments
QUANTITIES: dict[str, tuple[str, tuple[str, ...]]] = {
    "M": ("M", ("q",)),
    "C": ("C", ("q", "v")),
    "g": ("g", ("q",)),
    "christoffel": ("christoffel", ("q",)),
    "T": ("T", ("q", "v")),
    "V": ("V", ("q",)),
    "L": ("L", ("q", "v")),
    "H": ("H", ("q", "p")),
    "tau": ("inverse_dynamics", ("q", "v", "a")),
    "qdot": ("position_rate", ("q", "p")),
    "pdot": ("pdot", ("q", "p", "tau")),
}


class SymbolicManipulator:
    """A robot's dynamics in closed form, exact and canonical: equal functions have equal expressions.

    model       Model without mimic joints, or a source for ``load_urdf``: the name of a robot, a path, URDF text
    parameters  "numbers": the robot's own, as fractions. "symbols": masses, centres of mass, inertias, joint origins,
                armatures and gravity that are not 0 become symbols. A list with some of "mass", "com", "inertia",
                "origin", "armature", "gravity" and single names: only these become symbols. A mapping from names to
                symbols (or their names), expressions or numbers: these replace the robot's values, even a 0.

    Names: ``m_1`` mass, ``c_1x`` centre of mass, ``I_1xx`` .. ``I_1zz`` inertia about it, ``l_1x`` origin of the joint
    in the body that carries it, ``J_1`` armature; 1 is the first joint (``model.joints[1]``), whose body includes
    all bodies fixed to it, in the joint's frame. ``g`` is the magnitude of gravity along one axis; gravity in another
    direction has the components ``g_x``, ``g_y``, ``g_z``.

    q, v, a, p, tau   tuples of symbols: positions, velocities, accelerations, momenta, torques
    parameters        symbol -> the robot's number, None for a symbol in a given expression
    meaning           symbol -> meaning in words
    assumptions       floats that were replaced by exact numbers, such as an angle by a fraction of π

    Results are SymPy expressions, matrices and arrays, sums of sines and cosines of sums of the angles.

    >>> import spatialdyn as sd
    >>> s = SymbolicManipulator(sd.load_urdf("two_link"), {"c_1x": "l_1", "l_2x": "l_1", "c_2x": "l_2"})
    >>> s.M()[0, 1]
    l_1*l_2*cos(q_2) + l_2**2

    limit       largest number of products of terms for one quantity; None for no limit

    Closed forms grow exponentially with the number of joints about different axes. With the robots' numbers, M of the
    ur5 (six joints, three of them parallel) has 1400 operations and C 7200; g of the panda (seven joints) has 40 000,
    and M 660 000, which is beyond the limit, as is C. ``specialize(model, sd.crba).c_code()`` gives unsimplified code
    of any robot and call at once.

    Raises  ModelError for mimic joints; UrdfError for a robot that cannot be read; SpatialDynError naming an unknown
            parameter, or if sympy is not installed; its methods raise SpatialDynError for a quantity beyond the limit
    """

    @watch.call("SymbolicManipulator")
    def __init__(
        self,
        model: Any,
        parameters: str | Iterable[str] | Mapping[str, Any] = "numbers",
        limit: int | None = LONGEST,
    ) -> None:
        """Read the robot and choose its symbols."""
        if limit is not None and not (isinstance(limit, (int, float)) and limit > 0):
            raise SpatialDynError(f"limit is {literal(limit)}, expected a positive number of products, or None")
        if isinstance(model, str) or hasattr(model, "__fspath__"):
            model = load_urdf(model)
        if check_model(model).mimic_matrix is not None:
            raise ModelError(f'model "{model.name}" has mimic joints, expected one without (mimic=False) for symbols')
        self.model: Model = model
        sympy = self._sympy = engine.need_sympy()

        def named(letter: str, count: int) -> tuple[Expr, ...]:
            return tuple(sympy.Symbol(f"{letter}_{k}", real=True) for k in range(1, count + 1))

        self.q, self.v, self.a = named("q", model.nq), named("v", model.nv), named("a", model.nv)
        self.p, self.tau = named("p", model.nv), named("tau", model.nv)
        self._known = known = exact_robot(model)
        self.assumptions = tuple(known.assumptions)
        self._values = values = chosen_values(known, parameters)
        self.parameters, self.meaning = meanings(known, values, model.names)
        angles = [(kinds.KINDS[row["kind"]].angle, int(row["q_index"])) for row in model.bodies[1:]]
        self._turns = [at + angle for angle, at in angles if angle is not None]
        turning = [self.q[at] for at in self._turns]
        units = [tuple(self.q[k] for k in part) for part in kinds.unit_parts(model.bodies)]
        plain = (*self.q, *self.v, *self.a, *self.p, *self.tau, *self.parameters)
        if len(set(plain)) < len(plain):
            twice = next(x for x in self.parameters if x in plain[: -len(self.parameters)])
            raise SpatialDynError(f"parameter {twice} has the name of a coordinate, expected another")
        self._budget = engine.Budget(f'model "{model.name}"', math.inf if limit is None else limit)
        self._ring = known.ring.extended(turning, plain, units, self._budget)
        self._rows = exact_table(model, known, self._ring, values)
        self._frames = known.frames
        self._results: dict[Any, Any] = {}

    # --- running ------------------------------------------------------------------------------------------

    def _numbers(self, name: str, **static: Any) -> NumberArray:
        """The output of a public call on the symbols, in Numbers."""
        key = (name, *sorted((k, v) for k, v in static.items() if k != "placement"))
        if key not in self._results:
            spec = SPECS[name]
            own = {"q": self.q, "v": self.v, "a": self.a, "tau": self.tau}
            inputs: dict[str, Any] = dict(static)
            for x in spec.present:
                if x.name in own:
                    inputs[x.name] = _array([self._ring.of(s) for s in own[x.name]])
            sizes = {"nq": self.model.nq, "nv": self.model.nv, "njoints": self.model.njoints}
            self._results[key] = engine.run(spec, self._ring, self._rows, sizes, inputs)
        made: NumberArray = self._results[key]
        return made

    @watch.call("SymbolicManipulator.evaluate")
    def evaluate(
        self, name: Any, frame: str | Frame | None = None, reference: str = "local", classical: bool = False
    ) -> Any:
        """The result of a public call, by its name, on the symbols: ``s.evaluate("frame_placement", frame="tip")``.

        name  name of the call; or a control law: its torque, with its other inputs as symbols (``kp_1``, for a matrix
              ``kp_12``); for a law on a path also the path's q, v and a (``q_ref_1``, ``v_ref_1``, ``a_ref_1``)

        Its inputs are q, v, a, tau, without external forces. A vector is returned as a matrix of one column.

        Raises SpatialDynError for an unknown call, a call with other inputs, or a result without closed form, such as
        that of a law within limits

        >>> import spatialdyn as sd
        >>> s = SymbolicManipulator(sd.load_urdf("pendulum"))
        >>> s.evaluate(sd.PDGravity(9.0, 6.0, [0.5]))[0]
        -kd_1*v_1 - kp_1*q_1 + kp_1*q_ref_1 + 981*sin(q_1)/200
        """
        if not isinstance(name, str) and hasattr(name, "torque_spec"):
            return self._torque(getattr(name, "line", name.torque_spec))
        as_word("call", name, SPECS)
        static: dict[str, Any] = {}
        for x in SPECS[name].present:
            if x.name not in ("q", "v", "a", "tau", "row", "placement", "reference", "classical") and not x.optional:
                raise SpatialDynError(f'call "{name}" has the input {x.name}, expected one of q, v, a, tau, frame')
            if x.name == "placement":
                if frame is None:
                    raise SpatialDynError(f'call "{name}" needs a frame, expected its name')
                found = self.model.frame(frame)
                X = self._frames[f"{found.kind}:{found.name}"]
                entries = [*X.R[:3], X.p[0], *X.R[3:6], X.p[1], *X.R[6:], X.p[2], 0.0, 0.0, 0.0, 1.0]
                static["placement"] = _array([self._ring.taken(x) for x in entries]).reshape(4, 4)
                static["row"] = self.model.joints[found.joint].row
                static["frame"] = f"{found.kind}:{found.name}"
            elif x.name == "reference":
                static["reference"] = reference_code(reference)
            elif x.name == "classical":
                static["classical"] = int(classical)
        return self._shown(self._numbers(name, **static))

    def _torque(self, spec: Any) -> Any:
        """The torque of a control law, with its inputs beside q, v and tau as symbols of the same names."""
        sizes = {"nq": self.model.nq, "nv": self.model.nv, "njoints": self.model.njoints}
        known: dict[str, Any] = {"q": self.q, "v": self.v, "tau": self.tau}
        own = [x for x in spec.present if x.name not in known]
        if fixed := [x.name for x in own if x.static]:
            raise SpatialDynError(f'law "{spec.name}" has {", ".join(fixed)}, expected gains and references')
        shapes = {x.name: shape_in(x.shape, sizes) for x in own}
        for x in own:
            known[x.name] = [self._symbol(x, at) for at in np.ndindex(shapes[x.name])]
        turning = [known[x.name][at] for x in own if x.shape == Q.shape for at in self._turns]
        ring = self._ring.extended(turning, [symbol for name in shapes for symbol in known[name]])
        rows = exact_table(self.model, self._known, ring, self._values)
        inputs = {name: _array([ring.of(x) for x in given]) for name, given in known.items()}
        inputs |= {name: inputs[name].reshape(shape) for name, shape in shapes.items()}
        return self._shown(engine.run(spec, ring, rows, sizes, inputs), ring)

    def _symbol(self, x: Argument, at: tuple[int, ...]) -> Expr:
        """The symbol of an entry of a law's input; an input of one number has no index."""
        index = "_" + ("" if self.model.nv < 5 else "_").join(str(k + 1) for k in at)  # also for a gain (nv, 2 nv)
        symbol = self._sympy.Symbol(x.name if x.shape in ((), (1,)) else x.name + index, real=True)
        if symbol in self._ring.plain:
            raise SpatialDynError(f"input {symbol} of the law has the name of the robot's, expected another")
        return symbol

    def _shown(self, x: NumberArray, ring: Any = None) -> Any:
        """Numbers as expressions: a scalar, a column, a matrix or an array."""
        ring = self._ring if ring is None else ring
        flat = [ring.expression(e) for e in x.ravel()]
        self._budget.spent = 0  # for the next quantity
        if x.ndim == 0:
            return flat[0]
        if x.ndim <= 2:
            return self._sympy.ImmutableMatrix(x.shape[0], 1 if x.ndim == 1 else x.shape[1], flat)
        return self._sympy.ImmutableDenseNDimArray(flat, x.shape)

    @watch.call("SymbolicManipulator.simplify")
    def simplify(self, expression: Any) -> Any:
        """Canonical form of an expression in the robot's symbols, rational in sines and cosines of sums of its angles.

        Other symbols count as parameters. Matrices are simplified entry by entry.
        Raises SpatialDynError naming a part without such a form.
        """
        self._budget.spent = 0
        if hasattr(expression, "applyfunc"):
            return expression.applyfunc(self.simplify)
        expression = as_expression("expression", expression)
        strange = expression.free_symbols - set(self._ring.plain)
        ring = self._ring.extended(plain=sorted(strange, key=str)) if strange else self._ring
        return ring.expression(ring.of(expression))

    # --- Lagrange -----------------------------------------------------------------------------------------

    def M(self) -> Matrix:
        """Mass matrix M(q) (nv, nv), by the composite rigid body algorithm."""
        return self._shown(self._numbers("crba"))

    def g(self) -> Matrix:
        """Gravity torque g(q) = ∂V/∂q (nv, 1), by the recursive Newton-Euler algorithm."""
        return self._shown(self._numbers("generalized_gravity"))

    @watch.call("SymbolicManipulator.christoffel")
    def christoffel(self, route: str = "recursion") -> Any:
        """Christoffel symbols of the first kind Γ (nv, nv, nv): C_ij = Σ_k Γ_ijk v_k.

        route  "recursion": over the tree, for any joints. "derivatives": ½ (∂_k M_ij + ∂_j M_ik - ∂_i M_jk), for joints
               whose velocities are q̇. Both give the same expressions.

        Raises SpatialDynError for another route, or naming a joint whose velocities are not q̇
        """
        return self._shown(self._gamma(route))

    def _gamma(self, route: str) -> NumberArray:
        if as_word("route", route, ROUTES) == "recursion":
            return self._numbers("christoffel_symbols")
        self._coordinates("Christoffel symbols from derivatives")
        return christoffel_from_gradient(self._gradient(), self._sympy.Rational(1, 2))

    def _gradient(self) -> NumberArray:
        """∂M_ij/∂q_k (nv, nv, nv) of the entries of M."""
        return gradient(self._ring, self._numbers("crba"), self.q)

    @watch.call("SymbolicManipulator.C")
    def C(self, route: str = "recursion") -> Matrix:
        """Coriolis matrix C(q, v) (nv, nv) of the Christoffel symbols: Ṁ - 2C is skew.

        route  "recursion": C directly over the tree, in O(n d). "derivatives": Σ_k Γ_ijk v_k by ``christoffel``.
        """
        if as_word("route", route, ROUTES) == "recursion":
            return self._shown(self._numbers("coriolis_matrix"))
        return self._shown(coriolis_from_christoffel(self._ring, self._gamma(route), self.v))

    def inverse_dynamics(self) -> Matrix:
        """τ = M a + C v + g (nv, 1), by the recursive Newton-Euler algorithm."""
        return self._shown(self._numbers("rnea"))

    def equations_of_motion(self) -> list[Expr]:
        """M a + C v + g = τ, an equation for each freedom."""
        return [self._sympy.Eq(x, t) for x, t in zip(self.inverse_dynamics(), self.tau, strict=True)]

    def T(self) -> Expr:
        """Kinetic energy T(q, v) = ½ vᵀ M v."""
        return self._shown(self._numbers("kinetic_energy"))

    def V(self) -> Expr:
        """Potential energy V(q) of gravity."""
        return self._shown(self._numbers("potential_energy"))

    def L(self) -> Expr:
        """Lagrangian L(q, v) = T - V."""
        T, V = self._numbers("kinetic_energy"), self._numbers("potential_energy")
        return self._shown((T.reshape(1) - V.reshape(1)).reshape(()))

    # --- Hamilton -----------------------------------------------------------------------------------------

    @cached_property
    def _inverse(self) -> tuple[NumberArray, Any]:
        """Adjugate and determinant of M."""
        n = self.model.nv
        if n > LARGEST:
            raise SpatialDynError(
                f'model "{self.model.name}" has {n} freedoms, expected at most {LARGEST} for M⁻¹ in closed form'
            )
        return adjugate_and_determinant(self._ring, self._numbers("crba"))

    def _momenta(self) -> list[Any]:
        """adj(M) p."""
        p = [self._ring.of(x) for x in self.p]
        return [sum((a * x for a, x in zip(row, p, strict=True)), self._ring.of(0)) for row in self._inverse[0]]

    def H(self) -> Expr:
        """Hamiltonian H(q, p) = ½ pᵀ M⁻¹ p + V, up to four freedoms."""
        p, zero = [self._ring.of(x) for x in self.p], self._ring.of(0)
        twice = sum((x * y for x, y in zip(p, self._momenta(), strict=True)), zero)
        T = twice / (self._inverse[1] * 2) if self.p else zero
        return self._ring.expression(T) + self.V()

    def position_rate(self) -> Matrix:
        """q̇ = ∂H/∂p = M⁻¹ p (nv, 1)."""
        self._coordinates("Hamilton's equations")
        det = self._inverse[1]
        return self._shown(_array([x / det for x in self._momenta()]))

    def pdot(self) -> Matrix:
        """ṗ = -∂H/∂q + τ (nv, 1): ½ q̇ᵀ ∂M/∂q q̇ - g + τ with q̇ = M⁻¹ p."""
        self._coordinates("Hamilton's equations")
        det, w, dM = self._inverse[1], self._momenta(), self._gradient()
        gravity, n = self._numbers("generalized_gravity"), self.model.nv
        made = []
        for k in range(n):
            total = self._ring.of(0)
            for i, j in np.ndindex(n, n):
                total = total + dM[i, j, k] * w[i] * w[j]
            made.append(self._ring.expression(total / (det * det * 2)))
            made[-1] += self._ring.expression(self._ring.of(self.tau[k]) - gravity[k])
        self._budget.spent = 0
        return self._sympy.ImmutableMatrix(n, 1, made)

    def hamilton_equations(self) -> tuple[Matrix, Matrix]:
        """q̇ = ∂H/∂p and ṗ = -∂H/∂q + τ, functions of q, p and τ.

        Raises SpatialDynError naming a joint whose velocities are not q̇, or above four freedoms
        """
        return self.position_rate(), self.pdot()

    @watch.call("SymbolicManipulator.poisson_bracket")
    def poisson_bracket(self, F: Any, G: Any) -> Expr:
        """{F, G} = Σ ∂F/∂q_i ∂G/∂p_i - ∂F/∂p_i ∂G/∂q_i of two functions of q and p; dF/dt = {F, H} without torques.

        Raises SpatialDynError naming a joint whose velocities are not q̇
        """
        self._coordinates("Poisson brackets")
        F, G = as_expression("F", F), as_expression("G", G)
        for name, x in {"F": F, "G": G}.items():
            if not isinstance(x, self._sympy.Expr):
                raise SpatialDynError(f"{name} is {literal(x):.80}, expected one expression")
        bracket = self._sympy.Add(
            *(F.diff(x) * G.diff(p) - F.diff(p) * G.diff(x) for x, p in zip(self.q, self.p, strict=True))
        )
        try:
            return self.simplify(bracket)
        except SpatialDynError:  # for a function that is not rational, such as exp
            return bracket

    def _coordinates(self, what: str) -> None:
        for joint in self.model.joints[1:]:
            kind = int(self.model.bodies[joint.row - joint.nv + 1]["kind"])
            if kind not in kinds.R1:
                raise SpatialDynError(
                    f'joint "{joint.name}" is {joint.kind}, whose velocities are not the derivatives of its '
                    f"coordinates, expected revolute and prismatic joints for {what}"
                )

    # --- exports ------------------------------------------------------------------------------------------

    @watch.call("SymbolicManipulator.quantity")
    def quantity(self, what: Any) -> tuple[str, Any, tuple[str, ...]]:
        """Name, expression and arguments of a quantity (a key of QUANTITIES) or of an expression.

        Raises SpatialDynError for another name, or symbols that are not the robot's
        """
        if isinstance(what, str):
            if what not in QUANTITIES:
                raise SpatialDynError(f'quantity is "{what}", expected one of {", ".join(QUANTITIES)}')
            method, arguments = QUANTITIES[what]
            make: Callable[[], Any] = getattr(self, method)
            return what, make(), arguments
        if isinstance(what, (list, tuple)):
            rows = [[as_expression("quantity", x) for x in (row if isinstance(row, list) else [row])] for row in what]
            if len({len(row) for row in rows}) > 1:
                raise SpatialDynError(f"quantity is {literal(what):.80}, expected rows of one length")
            what = self._sympy.ImmutableMatrix(rows)
        what = as_expression("quantity", what)
        strange = sorted(what.free_symbols - set(self._ring.plain), key=str)
        if strange:
            raise SpatialDynError(f"expression has {', '.join(map(str, strange))}, expected the robot's symbols")
        groups = {"v": self.v, "a": self.a, "p": self.p, "tau": self.tau}
        return "f", what, ("q", *(name for name, x in groups.items() if what.free_symbols & set(x)))

    def _arguments(self, names: Sequence[str]) -> dict[str, tuple[Expr, ...]]:
        """Symbols of each argument of an exported function; parameters, if any, come last."""
        made = {name: getattr(self, name) for name in names}
        return made | ({"parameters": tuple(self.parameters)} if self.parameters else {})

    @watch.call("SymbolicManipulator.text")
    def text(self, what: Any) -> str:
        """A quantity or expression as plain text, with a line for each entry that is not 0."""
        name, value, _ = self.quantity(what)
        return printing.text(name, value)

    @watch.call("SymbolicManipulator.latex")
    def latex(self, what: Any) -> str:
        """LaTeX of a quantity or expression; velocities are written with dots."""
        return printing.latex(self.quantity(what)[1], self.v, self.a)

    @watch.call("SymbolicManipulator.lambdify")
    def lambdify(self, what: Any) -> Callable[..., NDArray[np.float64]]:
        """A NumPy function of a quantity or expression: ``f(q)``, ``f(q, v)``, ... on arrays of any batch shape.

        With symbolic parameters its last argument is ``parameters`` (..., number of them), in the order of
        ``self.parameters``; by default the robot's values.
        """
        name, value, arguments = self.quantity(what)
        own = list(self.parameters.values())
        default = None if None in own else np.array([float(x) for x in own if x is not None])
        return printing.function(name, value, self._arguments(arguments), default)

    @watch.call("SymbolicManipulator.python_code")
    def python_code(self, what: Any) -> str:
        """Python text of a function for a quantity or expression, for one sample; it needs NumPy only."""
        name, value, arguments = self.quantity(what)
        return printing.python_code(name, value, self._arguments(arguments))

    @watch.call("SymbolicManipulator.c_code")
    def c_code(self, what: Any) -> str:
        """C99 text of a function for a quantity or expression: ``void M(const double *q, ..., double *out)``."""
        name, value, arguments = self.quantity(what)
        return printing.c_code(name, value, self._arguments(arguments))

    def __repr__(self) -> str:
        return f"<SymbolicManipulator {self.model.name}: nv {self.model.nv}, {len(self.parameters)} parameters>"

    def _repr_html_(self) -> str:
        from ..pictures.notebook import symbols_html

        return symbols_html(self)


def _array(x: Sequence[Any]) -> NumberArray:
    """An object array of Numbers, which NumPy does not convert."""
    made = np.empty(len(x), dtype=object)
    made[:] = x
    return made
