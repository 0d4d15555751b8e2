"""Several constructions of the Coriolis matrix C, and a test of their properties.

The equation of motion determines C q̇ but not C: a matrix B with B q̇ = 0 may be added. Three properties of C, with
N = Ṁ - 2C:

weak      q̇ᵀ N q̇ = 0: power is conserved; every C with the right C q̇ has this property
strong    N is skew-symmetric, Ṁ = C + Cᵀ: needed in proofs of passivity, where C multiplies an error, not q̇
torsion   C(v) w - C(w) v = 0 for coordinates: together with "strong" it makes C that of the Christoffel symbols

The velocities of spherical, floating and planar joints are not rates of coordinates but components along fields X_k
with brackets [X_j, X_k] = Σ c^m_jk X_m, and the last property becomes C(v) w - C(w) v = <X_i, [v, w]>. As v holds
twists in the body's frame, S_j × S_k = Σ c^m_jk S_m. An armature on such a joint multiplies the acceleration only: the
metric <,> and C do not contain it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls import dynamics
from ..calls.arguments import as_array, as_flag, as_number, batch_shape, broadcast, check_model
from ..errors import ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..recursions.spec import Q, V
from ..waiting import watch
from .lie_brackets import structure_constants

Array = NDArray[np.float64]
LEAST_STEP = 1e-12  # below this step M(q + h) - M(q - h) is rounding
STEP = 5e-3  # of sixth-order differences: h⁶ and eps / h are both about 1e-13 of M
STENCIL = ((1, 45.0 / 60.0), (2, -9.0 / 60.0), (3, 1.0 / 60.0))


def _joints_of_several_freedoms(model: Model) -> list[tuple[range, slice]]:
    """Rows of the table and places in v."""
    several = [joint for joint in model.joints[1:] if joint.nv > 1]
    return [(range(j.row - j.nv + 1, j.row + 1), slice(j.idx_v, j.idx_v + j.nv)) for j in several]


def _brackets(model: Model, q: ArrayLike) -> Array:
    """<X_i, [X_j, X_k]>, (..., nv, nv, nv)."""
    M = dynamics.crba(model, q).copy()
    for rows, own in _joints_of_several_freedoms(model):
        for row, k in zip(rows, range(own.start, own.stop), strict=True):
            M[..., k, k] -= model.bodies[row].armature
    found: Array = np.einsum("...im,mjk->...ijk", M, structure_constants(model))
    return found


class ChristoffelC:
    """C(q, v) of one model by several constructions; all give the same C v.

    ======================  ======  =========  =============  ==========================================
    method                  weak    strong     torsion-free   cost of a sample of n freedoms in depth d
    ======================  ======  =========  =============  ==========================================
    recursive               yes     yes        yes            O(n d)
    from_derivatives        yes     yes        yes            O(n d²) + O(n³) of sums
    by_finite_differences   yes     nearly     nearly         6 n mass matrices; digits are lost
    by_rnea_columns         yes     if the     no brackets    2 n + 1 runs of rnea, O(n²)
                                    joints are of one coordinate
    not_christoffel         yes     as asked   no             for contrast
    ======================  ======  =========  =============  ==========================================

    model  Model

    ``ChristoffelC(model)(q, v)`` is its ``recursive``. Every method takes q (..., nq) [rad | m] and v (..., nv)
    [rad/s | m/s] and returns C (..., nv, nv) [kg m²/s | kg m/s | kg/s]; it raises what the public calls raise, such as
    ShapeError and NonFiniteError.

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> construct = ChristoffelC(model)
    >>> q, v = [0.5, -0.3], [1.0, 2.0]
    >>> bool(np.allclose(construct(q, v), construct.from_derivatives(q, v), atol=1e-14))
    True
    """

    def __init__(self, model: Model) -> None:
        """Raises ModelError if model is not a Model."""
        self.model = check_model(model)

    def __repr__(self) -> str:
        return f'ChristoffelC("{self.model.name}", nv={self.model.nv})'

    def __call__(self, q: ArrayLike, v: ArrayLike) -> Array:
        """C of the Christoffel symbols, by ``recursive``, the cheapest construction."""
        return self.recursive(q, v)

    def recursive(self, q: ArrayLike, v: ArrayLike) -> Array:
        """C by two sweeps over the tree, ``sd.coriolis_matrix``: strong and torsion-free on all joints, O(n d)."""
        return dynamics.coriolis_matrix(self.model, q, v)

    def from_derivatives(self, q: ArrayLike, v: ArrayLike) -> Array:
        """C from the analytic ∂M/∂q by Christoffel's formula, on joints of several freedoms by Koszul's.

        2 Γ_ijk = ∂_k M_ij + ∂_j M_ik - ∂_i M_jk + <X_i, [X_k, X_j]> - <X_j, [X_k, X_i]> - <X_k, [X_j, X_i]>.
        Strong and torsion-free, O(n d²) for ∂M/∂q and O(n³) for the sums.
        """
        return self._koszul(q, v, dynamics.mass_matrix_derivatives(self.model, q))

    @watch.call("ChristoffelC.by_finite_differences")
    def by_finite_differences(self, q: ArrayLike, v: ArrayLike, h: float = STEP) -> Array:
        """The same from ∂M/∂q by central differences of sixth order, for debugging; error about 1e-12 of M.

        h  step along integrate(q, h e_k) [rad | m]

        C needs all three terms and v: the quotient (M(q + h e_j) - M(q - h e_j)) / 2h, which some texts call the entry
        C_ij, is a slice of ∂M/∂q and not a Coriolis matrix.

        Strong and torsion-free up to the error of the differences; 6 n mass matrices.
        Raises  SpatialDynError if h is not a positive number.
        """
        if not LEAST_STEP <= as_number(h) < np.inf:
            raise SpatialDynError(f"h is {literal(h)}, expected a positive number, {LEAST_STEP:g} at least")
        q, E = self._given(q), np.eye(self.model.nv)
        dM = np.zeros((*q.shape[:-1], *(self.model.nv,) * 3))
        for steps, weight in STENCIL:
            ahead, behind = (
                dynamics.crba(self.model, dynamics.integrate(self.model, q[..., None, :], sign * steps * h * E))
                for sign in (1.0, -1.0)
            )
            dM += weight / h * np.moveaxis(ahead - behind, -3, -1)
        return self._koszul(q, v, dM)

    @watch.call("ChristoffelC.by_rnea_columns")
    def by_rnea_columns(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Columns ½ (c(v + e_j) - c(v) - c(e_j)) of the quadratic form c(v) = C v: half of ∂(C v)/∂v.

        This is the only C that is symmetric in velocities: C(v) w = C(w) v. For coordinates it is the Christoffel C. On
        joints of several freedoms it lacks half of the bracket term <X_i, [v, e_j]>, and with it the strong property;
        C v is correct there too. 2 n + 1 runs of rnea.
        """
        q, v = self._given(q), self._given(v, "v")
        E, still = np.eye(self.model.nv), self.model.with_(gravity=(0.0, 0.0, 0.0))

        def form(velocity: Array) -> Array:
            return dynamics.nonlinear_effects(still, q[..., None, :], velocity)

        columns = 0.5 * (form(v[..., None, :] + E) - form(v[..., None, :]) - form(E))
        return np.ascontiguousarray(np.swapaxes(columns, -1, -2))

    def not_christoffel(self, q: ArrayLike, v: ArrayLike, skew: bool = True) -> Array:
        """A valid C that differs from that of the Christoffel symbols, for contrast.

        skew=True   Σ Jᵀ (I J̇ + v ×* I J) over the bodies: N is skew-symmetric, yet C(v) w - C(w) v is not zero, so
                    skewness alone proves nothing; O(n² d)
        skew=False  Ṁ - ½ (∂_i M_jk v_k), Lagrange's equation before its indices are symmetrised (with the brackets of
                    quaternion joints): weak only; O(n d²)
        """
        if as_flag("skew", skew):
            return self._body_factor(q, v)
        v = self._given(v, "v")
        dM, brackets = dynamics.mass_matrix_derivatives(self.model, q), _brackets(self.model, q)
        by_i = 0.5 * np.einsum("...jki,...k->...ij", dM, v) + np.einsum("...kji,...k->...ij", brackets, v)
        return np.asarray(dynamics.mass_matrix_dot(self.model, q, v) - by_i)

    # -- the parts

    def _given(self, x: ArrayLike, name: str = "q") -> Array:
        """q or v as an array with a checked last axis."""
        array = as_array(name, x)
        batch_shape(self.model, Q if name == "q" else V, array)
        return array

    def _koszul(self, q: ArrayLike, v: ArrayLike, dM: Array) -> Array:
        """½ Σ_k (...) v_k, where (...) is the bracket of Koszul's formula."""
        v, L = self._given(v, "v"), _brackets(self.model, q)
        broadcast(["q", "v"], [dM.shape[:-3], v.shape[:-1]])
        symbols = dM + np.swapaxes(dM, -1, -2) - np.moveaxis(dM, -1, -3)
        symbols = symbols + np.swapaxes(L, -1, -2) - np.moveaxis(L, -1, -3) - np.einsum("...kji->...ijk", L)
        return np.asarray(0.5 * np.einsum("...ijk,...k->...ij", symbols, v))

    def _body_factor(self, q: ArrayLike, v: ArrayLike) -> Array:
        """The factor v ×* I, which is B plus ½ (v ×* I w - w ×* I v + I (v × w)), a term that is 0 for w = v."""
        q, v, model = self._given(q), self._given(v, "v"), self.model
        C = dynamics.coriolis_matrix(model, q, v).copy()
        for joint in model.joints[1:]:
            body = model.bodies[joint.row].inertia
            J = dynamics.frame_jacobian(model, q, f"joint:{joint.name}")
            I = np.block([[body.m * np.eye(3), -_skew(_vector(body.h))], [_skew(_vector(body.h)), _symmetric(body.I)]])
            with np.errstate(invalid="ignore"):  # an infinite v has NaN
                moving = np.einsum("...ij,...j->...i", J, v)
                X = _crm(moving)
                f = -np.swapaxes(X, -1, -2) @ I + I @ X + _of_force(np.einsum("ij,...j->...i", I, moving))
                C = C + 0.5 * np.swapaxes(J, -1, -2) @ f @ J
        return C


def _vector(h: np.void) -> Array:
    return np.array([h["x"], h["y"], h["z"]])


def _symmetric(I: np.void) -> Array:
    rows = (("xx", "xy", "xz"), ("xy", "yy", "yz"), ("xz", "yz", "zz"))
    return np.array([[I[name] for name in row] for row in rows])


def _skew(a: Array) -> Array:
    """a×, (..., 3, 3)."""
    o = np.zeros(a.shape[:-1])
    x, y, z = np.moveaxis(a, -1, 0)
    return np.stack([np.stack(row, -1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))], -2)


def _crm(v: Array) -> Array:
    """v× of motions (..., 6), linear first."""
    w, l = _skew(v[..., 3:]), _skew(v[..., :3])
    return np.concatenate([np.concatenate([w, l], -1), np.concatenate([0.0 * w, w], -1)], -2)


def _of_force(f: Array) -> Array:
    """m -> -(m ×* f) for forces f (..., 6), linear first."""
    n, l = _skew(f[..., 3:]), _skew(f[..., :3])
    return np.concatenate([np.concatenate([0.0 * l, l], -1), np.concatenate([l, n], -1)], -2)


@dataclass(frozen=True)
class SkewSymmetry:
    """Result of ``verify_skew_symmetry``, with N = Ṁ - 2C; rounding errors are a few eps of ``scale``.

    weak     vᵀ N v [W]
    strong   max |N + Nᵀ|
    torsion  max |C(v) e_j - C(e_j) v - <X_i, [v, e_j]>| over all j; None if C was a matrix
    scale    the largest entry of C and Ṁ
    """

    model: str
    weak: float
    strong: float
    torsion: float | None
    scale: float

    def __repr__(self) -> str:
        torsion = "not defined for a matrix" if self.torsion is None else f"{self.torsion:.1e}"
        return (
            f'<Ṁ - 2C of "{self.model}": weak {self.weak:.1e}, strong {self.strong:.1e}, torsion {torsion}; '
            f"largest entry {self.scale:.1e}>"
        )


@watch.call("verify_skew_symmetry")
def verify_skew_symmetry(
    model: Model, q: ArrayLike, v: ArrayLike, C: ArrayLike | Callable[[Array], ArrayLike] | None = None
) -> SkewSymmetry:
    """Deviation of Ṁ - 2C from skew symmetry, and of C from the matrix of the Christoffel symbols.

    q  (nq,)  joint positions [rad | m]
    v  (nv,)  joint velocities [rad/s | m/s]
    C  (nv, nv) a matrix, or a function of v (nv,) that returns one; ``sd.coriolis_matrix`` at q if left out

    A matrix with skewness and zero torsion is that of the Christoffel symbols; with skewness alone it may be another
    one (``ChristoffelC.not_christoffel``). The result is NaN or inf if q or v is not finite or a product overflows.

    Raises  ShapeError for shapes that do not match, and the errors of mass_matrix_dot.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> found = verify_skew_symmetry(model, [0.5, -0.3], [1.0, 2.0])
    >>> max(abs(found.weak), found.strong, found.torsion) < 1e-15
    True
    """
    check_model(model)
    q, v = as_array("q", q), as_array("v", v)
    for name, x, size in (("q", q, model.nq), ("v", v, model.nv)):
        if x.shape != (size,):
            raise ShapeError(f"{name} has shape {x.shape}, expected ({size},)")

    def matrix(value: ArrayLike) -> Array:
        found = as_array("C", value)
        if found.shape != (model.nv, model.nv):
            raise ShapeError(f"C has shape {found.shape}, expected ({model.nv}, {model.nv})")
        return found

    given = C if C is not None else lambda velocity: dynamics.coriolis_matrix(model, q, velocity)
    at_v = matrix(given(v) if callable(given) else given)
    rate = dynamics.mass_matrix_dot(model, q, v)
    of_unit = [matrix(given(e)) for e in np.eye(model.nv)] if callable(given) else []
    torsion = None
    with np.errstate(over="ignore", invalid="ignore"):  # NaN if not finite, as in calls on q and v
        N = rate - 2.0 * at_v
        if callable(given):
            back = np.zeros((model.nv, model.nv))
            for j, C_j in enumerate(of_unit):
                back[:, j] = C_j @ v
            twist = np.einsum("ikj,k->ij", _brackets(model, q), v)
            torsion = float(abs(at_v - back - twist).max(initial=0.0))
        scale = max(abs(at_v).max(initial=0.0), abs(rate).max(initial=0.0))
        weak, strong = float(v @ N @ v), float(abs(N + N.T).max(initial=0.0))
    return SkewSymmetry(model.name, weak, strong, torsion, float(scale))
