"""The writer of LLVM text: a function body that names its values in order."""

from __future__ import annotations


class Body:
    """The instructions of one function, in order.

    A value is text: a name that ``put`` returned, or a constant. Kinds are LLVM types: ``double``, ``<8 x double>``.
    """

    def __init__(self) -> None:
        """An empty body."""
        self.lines: list[str] = []
        self._values = 0

    def put(self, text: str) -> str:
        """Append an instruction with a result; returns the result's name."""
        self._values += 1
        self.lines.append(f"  %t{self._values} = {text}")
        return f"%t{self._values}"

    def do(self, text: str) -> None:
        """Append an instruction without a result, or whose text names it."""
        self.lines.append(f"  {text}")

    def label(self, name: str) -> None:
        """Start a block; the one before must end in a jump."""
        self.lines.append(f"{name}:")

    def jump(self, to: str, then: str) -> None:
        """End a block by a jump, and start the next."""
        self.do(f"br label %{to}")
        self.label(then)

    def branch(self, condition: str, yes: str, no: str, then: str) -> None:
        """End a block by a conditional jump, and start the next."""
        self.do(f"br i1 {condition}, label %{yes}, label %{no}")
        self.label(then)

    def load(self, kind: str, address: str, align: int = 0) -> str:
        """Load a value of a kind from an address."""
        return self.put(f"load {kind}, ptr {address}" + (f", align {align}" if align else ""))

    def store(self, kind: str, value: str, address: str, align: int = 0, stream: bool = False) -> None:
        """Store a value at an address; ``stream`` bypasses the CPU caches, in modules that define !0."""
        how = (f", align {align}" if align else "") + (", !nontemporal !0" if stream else "")
        self.do(f"store {kind} {value}, ptr {address}{how}")

    def at(self, kind: str, base: str, count: int | str) -> str:
        """The address of value ``count`` of a kind behind ``base``."""
        return self.put(f"getelementptr {kind}, ptr {base}, i64 {count}")

    def byte(self, base: str, count: int | str) -> str:
        """The address ``count`` bytes behind ``base``."""
        return self.at("i8", base, count)

    def copy(self, to: str, start: str, count: int | str) -> None:
        """Copy ``count`` bytes from ``start`` to ``to``."""
        self.do(f"call void @llvm.memcpy.p0.p0.i64(ptr {to}, ptr {start}, i64 {count}, i1 false)")

    def move(self, to: str, start: str, count: int | str) -> None:
        """Copy ``count`` bytes from ``start`` to ``to``, which may overlap."""
        self.do(f"call void @llvm.memmove.p0.p0.i64(ptr {to}, ptr {start}, i64 {count}, i1 false)")

    def add(self, a: int | str, b: int | str) -> str:
        """a + b of i64."""
        return self.put(f"add i64 {a}, {b}")

    def times(self, a: int | str, b: int | str) -> str:
        """a b of i64."""
        return self.put(f"mul i64 {a}, {b}")

    def both(self, a: str, b: str) -> str:
        """Whether two conditions hold."""
        return self.put(f"and i1 {a}, {b}")

    def boundary(self, address: str, size: int) -> str:
        """An aligned address: a multiple of ``size`` behind ``address``."""
        behind = self.add(self.put(f"ptrtoint ptr {address} to i64"), size + 1)
        return self.put(f"inttoptr i64 {self.put(f'and i64 {behind}, {-size}')} to ptr")

    def function(self, head: str, attributes: str = "") -> str:
        """The text of the function; ``head`` is its signature, ``define void @f(ptr %x)``."""
        body = "\n".join(self.lines)
        return f"{head}{attributes} {{\n{body}\n}}\n"
