"""The writer of LLVM text: its text compiles, and computes."""

from __future__ import annotations

import ctypes

import numpy as np

from spatialdyn.engines.programs.llvm.host_cpu import LoadedCode, object_code
from spatialdyn.engines.programs.llvm.llvm_text import Body


def test_values_are_numbered_in_order() -> None:
    body = Body()
    assert [body.add("%n", 1), body.times("%n", 2), body.byte("%x", 3)] == ["%t1", "%t2", "%t3"]
    body.do("ret void")
    assert body.lines[0] == "  %t1 = add i64 %n, 1"
    assert (
        body.function("define void @f(ptr %x, i64 %n)", " #0").splitlines()[0] == "define void @f(ptr %x, i64 %n) #0 {"
    )


def test_loads_stores_and_blocks_are_code_that_runs() -> None:
    """Sums i doubles, then doubles the sum, and copies it behind."""
    body = Body()
    body.label("start")
    body.jump("loop", then="loop")
    body.do("%i = phi i64 [ 0, %start ], [ %next, %loop ]")
    body.do("%sum = phi double [ 0.0, %start ], [ %more, %loop ]")
    x = body.load("double", body.at("double", "%x", "%i"), 8)
    body.do(f"%more = fadd double %sum, {x}")
    body.do("%next = add i64 %i, 1")
    body.branch(body.put("icmp slt i64 %next, %n"), "loop", "end", then="end")
    body.store("double", body.put("fmul double %more, 2.0"), "%out", 8)
    body.copy(body.byte("%out", 8), "%out", 8)
    body.do("ret void")
    declared = "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)\n"
    loaded = LoadedCode(object_code(declared + body.function("define void @f(ptr %x, i64 %n, ptr %out)")))
    x, out = np.arange(5.0), np.zeros(2)
    call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p)(loaded.address("f"))
    call(x.ctypes.data, 5, out.ctypes.data)
    np.testing.assert_array_equal(out, [20.0, 20.0])


def test_a_boundary_lies_behind_an_address() -> None:
    body = Body()
    body.store("ptr", body.boundary("%x", 64), "%out")
    body.do("ret void")
    loaded = LoadedCode(object_code(body.function("define void @f(ptr %x, ptr %out)")))
    call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(loaded.address("f"))
    for address in (0, 1, 63, 64, 65, 100):
        out = np.zeros(1, np.int64)
        call(address, out.ctypes.data)
        assert out[0] % 64 == 0
        assert address < out[0] <= address + 128
