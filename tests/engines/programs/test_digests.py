"""The digest of compiled code covers all it depends on: any change gives another file."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import llvmlite
import numba
import numpy as np
import pytest
from inputs import empty_memory, sorted_inputs
from numba import types
from numba.core import compiler
from numba.core.cpu import FastMathOptions
from numba.core.typing.templates import AbstractTemplate
from trees import random_tree

import spatialdyn as sd
from spatialdyn.algebra import spatial
from spatialdyn.engines.compiled import numba_cache, numba_kernels
from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.parameters import Parameter
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.recursions import SPECS

BALL = (1.0, (0.1, 0.2, 0.3), np.diag([0.1, 0.1, 0.1]))

# --- programs --------------------------------------------------------------------------------------------


class Digests:
    """Digests of programs, without recording or reading one."""

    def __init__(self, patch: pytest.MonkeyPatch, model: sd.Model) -> None:
        self.model = model
        empty_memory(patch)
        patch.setattr(batch_kernels, "_from_disk_cache", lambda digest, kind: None)
        patch.setattr(batch_kernels, "record", self._refuse)

    def _refuse(self, *arguments: Any) -> Any:
        raise ZeroDivisionError

    def __call__(self, *names: str, key: str | None = None, forces: bool = False, **more: Any) -> str:
        """The digest of the program of some calls."""
        batch_kernels.forget()
        specs = tuple(numba_kernels.variant(SPECS[name], frozenset(["fext"] * forces)) for name in names or ("rnea",))
        batch_kernels.kernel(specs, self.model.bodies, key or self.model.key, **more)
        (digest,) = batch_kernels._programs
        return digest


@pytest.fixture
def digest(monkeypatch: pytest.MonkeyPatch) -> Digests:
    return Digests(monkeypatch, random_tree(2, 3, ["revolute", "prismatic"]).model)


def test_a_program_is_named_by_model_calls_inputs_and_form(digest: Digests) -> None:
    v0, v1 = ("v", (0.0,) * 3), ("v", (0.0, 1.0, 0.0))
    heavier = digest.model.with_(gravity=(0, 0, -1))
    ways: list[dict[str, Any]] = [
        {},
        {"key": heavier.key},
        {"forces": True},
        {"dtype": np.float32},
        {"one": True},
        {"stream": True},
        {"one": True, "dtype": np.float32},
        {"stream": True, "dtype": np.float32},
        {"options": recording.ProgramOptions(fixed=(v0,))},
        {"options": recording.ProgramOptions(fixed=(v1,))},
        {"options": recording.ProgramOptions(fixed=(("a", (0.0,) * 3),))},
        {"options": recording.ProgramOptions(parameters=(Parameter("mass", 1),))},
        {"options": recording.ProgramOptions(parameters=(Parameter("mass", 2),))},
        {"options": recording.ProgramOptions(parameters=(Parameter("com", 2),))},
        {"options": recording.ProgramOptions(parameters=(Parameter("payload", 2, (1.0, 0.0, 0.0)),))},
        {"options": recording.ProgramOptions(parameters=(Parameter("payload", 2, (1.0, 0.0, 0.5)),))},
        {"options": recording.ProgramOptions(outputs=((0, 1),))},
        {"options": recording.ProgramOptions(outputs=((1, 0),))},
        {"options": recording.ProgramOptions(ranged=True)},
        {"options": recording.ProgramOptions(double_double=True)},
    ]
    names = [digest(**way) for way in ways]
    names += [digest("crba"), digest("rnea", "crba"), digest("crba", "rnea"), digest("aba")]
    assert len(set(names)) == len(names)
    assert [digest(**way) for way in ways] == names[: len(ways)]


def test_a_program_is_named_by_each_of_its_static_inputs(digest: Digests) -> None:
    """Row, placement and reference of a frame."""
    assert [x.name for x in SPECS["frame_jacobian"].present if x.static] == ["row", "placement", "reference"]
    X, Y = np.eye(4), np.eye(4)
    Y[0, 3] = 1e-16
    statics = [(1, X, 0), (2, X, 0), (1, X, 1), (1, X, 2), (2, X, 1), (1, Y, 0), (11, X, 0), (1, -X, 0)]
    names = [digest("frame_jacobian", static=static) for static in statics]
    assert len(set(names)) == len(statics)
    assert digest("frame_jacobian", static=(1, np.eye(4), 0)) == names[0]


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no programs")
def test_frames_and_references_have_programs_of_their_own() -> None:
    """By the public call, so that the digest has the program's own inputs."""
    model = random_tree(2, 3, ["revolute", "prismatic"]).model
    q = sd.random_configuration(model, np.random.default_rng(0), (512,))
    for frame in model.frames[-2:]:
        for reference in ("local", "world", "local_world_aligned"):
            J = sd.frame_jacobian(model, q, frame, reference)
            for k in (0, 100):
                np.testing.assert_allclose(J[k], sd.frame_jacobian(model, q[k], frame, reference), atol=1e-13)


def test_a_program_is_named_by_sources_processor_and_versions(digest: Digests, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [digest()]
    processor, features, width, fma = host_cpu.host()

    def changed(owner: Any, what: str, value: Any) -> None:
        with monkeypatch.context() as patch:
            patch.setattr(owner, what, value)
            names.append(digest())

    changed(batch_kernels, "STAMP", "edited")
    changed(host_cpu, "host", lambda: ("another", features, width, fma))
    changed(host_cpu, "host", lambda: (processor, features + ",+more", width, fma))
    changed(host_cpu, "llvm_version", lambda: "0.1")
    changed(batch_kernels, "DATA_OFFSET", batch_kernels.DATA_OFFSET + 8)
    assert len(set(names)) == len(names)
    assert digest() == names[0]


def test_a_model_is_named_by_each_part_of_its_mimics() -> None:
    """The leading joint, the ratio and the offset of a mimic joint: v_full = G v holds the first two only."""

    def hand(leader: str = "a", multiplier: float = 2.0, offset: float = 0.5) -> str:
        builder = sd.ModelBuilder("hand")
        mimic = {"leader": leader, "multiplier": multiplier, "offset": offset}
        for name, follows in (("a", None), ("b", None), ("c", mimic)):
            builder.add_body(f"link {name}", axis=(0, 1, 0), inertia=BALL, joint_name=name, mimic=follows)
        return str(builder.build(mimic=True).key)

    names = [hand(), hand(offset=0.25), hand(offset=0.0), hand(multiplier=-2.0), hand(leader="b")]
    assert len(set(names)) == len(names)
    assert hand() == names[0]


# --- kernels ---------------------------------------------------------------------------------------------


def twice(stamp: str, name: str = "twice", line: str = "2.0 * x") -> Callable[..., Any]:
    """A function like a kernel: made from text, with a stamp in its closure."""
    scope: dict[str, Any] = {"double": lambda x: 2.0 * x, "triple": lambda x: 3.0 * x}
    exec(f"def make(stamp):\n    def {name}(x):\n        stamp\n        return {line}\n    return {name}", scope)
    made: Callable[..., Any] = scope["make"](stamp)
    made.__module__ = __name__
    made.__qualname__ = name
    return made


class Codegen:
    """Numba's description of the target CPU."""

    def __init__(self, *magic: str) -> None:
        self.magic = magic

    def magic_tuple(self) -> tuple[str, ...]:
        return self.magic


HERE = Codegen("triple", "cpu", "features")


def kernel_name(function: Callable[..., Any], sig: Any = (types.float64,), codegen: Any = HERE) -> str:
    return numba_cache.NumbaCache(function)._digest(sig, codegen)


def test_a_kernel_is_named_by_its_text_closure_signature_and_processor() -> None:
    names = [
        kernel_name(twice("a")),
        kernel_name(twice("b")),
        kernel_name(twice("a", name="other")),
        kernel_name(twice("a", line="3.0 * x")),
        kernel_name(twice("a", line="x * 2.0")),
        kernel_name(twice("a", line="double(x)")),
        kernel_name(twice("a", line="triple(x)")),
        kernel_name(twice("a"), (types.float32,)),
        kernel_name(twice("a"), (types.float64, types.float64)),
        kernel_name(twice("a"), codegen=Codegen("triple", "another cpu", "features")),
        kernel_name(twice("a"), codegen=Codegen("triple", "cpu", "features,+more")),
    ]
    moved = twice("a")
    moved.__module__ = "elsewhere"
    names.append(kernel_name(moved))
    assert len(set(names)) == len(names)
    assert kernel_name(twice("a")) == names[0]


BESIDE_SOURCES = [
    *((owner, "__version__") for owner in (numba, llvmlite, np)), (sys, "version"),
    *((numba.config, name) for name in ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK")),
]  # fmt: skip


@pytest.mark.parametrize(("owner", "what"), BESIDE_SOURCES)
def test_a_kernel_is_named_by_the_versions_and_settings_that_compiled_it(
    monkeypatch: pytest.MonkeyPatch, owner: Any, what: str
) -> None:
    before = kernel_name(twice("a"))
    with monkeypatch.context() as patch:
        patch.setattr(owner, what, f"{getattr(owner, what)}+")
        assert kernel_name(twice("a")) != before
    assert kernel_name(twice("a")) == before


def test_every_kernel_captures_the_stamp(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that an edited helper, which is not in the kernel's own text, gives another file."""
    function = numba_kernels.kernel_from_text("nothing", ["x"], ["stamp", "return x"], {})
    assert inspect.getclosurevars(function).nonlocals == {"stamp": numba_kernels.STAMP}
    before = kernel_name(function)
    monkeypatch.setattr(numba_kernels, "STAMP", "edited")
    assert kernel_name(numba_kernels.kernel_from_text("nothing", ["x"], ["stamp", "return x"], {})) != before


def test_calls_with_and_without_an_optional_input_have_two_names() -> None:
    labels = [
        numba_kernels.label(numba_kernels.variant(spec, frozenset(some)))
        for spec in SPECS.values()
        for some in _choices(spec)
    ]
    assert len(set(labels)) == len(labels)


def _choices(spec: Any) -> list[list[str]]:
    optional = [x.name for x in sorted_inputs(spec) if x.optional]
    return [[], *([name] for name in optional), *([optional] if len(optional) > 1 else [])]


# --- inlined functions -----------------------------------------------------------------------------------


def inlined_name(
    function: Callable[..., Any] = spatial.cross_motion,
    args: tuple[Any, ...] = (types.float64,),
    stamp: str = "a",
    magic: str = "cpu",
    **flags: Any,
) -> str:
    made_flags: Any = compiler.Flags
    asked = made_flags()
    for name, x in flags.items():
        setattr(asked, name, x)
    target = SimpleNamespace(codegen=lambda: Codegen("triple", magic, "features"))
    state = SimpleNamespace(args=args, return_type=None, flags=asked, targetctx=target)
    return numba_cache.InlinedCache(stamp).digest(function, state)


def test_an_inlined_function_is_named_by_all_that_its_code_depends_on(monkeypatch: pytest.MonkeyPatch) -> None:
    array: Any = types.Array
    names = [
        inlined_name(),
        inlined_name(spatial.cross_force),
        inlined_name(args=(types.float32,)),
        inlined_name(args=(array(types.float64, 1, "C"),)),
        inlined_name(args=(array(types.float64, 1, "A"),)),
        inlined_name(args=(types.UniTuple(types.float64, 2),)),
        inlined_name(stamp="b"),
        inlined_name(magic="another cpu"),
        inlined_name(error_model="numpy"),
        inlined_name(fastmath=FastMathOptions({"contract"})),
    ]
    for owner, what in BESIDE_SOURCES:
        with monkeypatch.context() as patch:
            patch.setattr(owner, what, f"{getattr(owner, what)}+")
            names.append(inlined_name())
    assert all(names)
    assert len(set(names)) == len(names)
    assert inlined_name() == names[0]


def test_a_function_is_not_kept_where_its_name_does_not_tell_what_it_does() -> None:
    def local(x: float) -> float:
        return x

    local.__module__ = spatial.__name__
    passed: Any = types.Function
    assert inlined_name(local) == ""  # another of that name may have another text
    assert inlined_name(twice("a")) == ""  # of no stamped room
    assert inlined_name(args=(passed(Template),)) == ""  # a function's type
    assert inlined_name(args=(types.Tuple((types.float64, passed(Template))),)) == ""


class Template(AbstractTemplate):
    """What Numba knows of a function that is passed to another."""

    key = "a function"
