"""Rows: one number for each observation of a batch, whose arithmetic becomes nodes of an ONNX graph."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from onnx import NodeProto, TensorProto, ValueInfoProto, helper, numpy_helper


class Builder:
    """Nodes of a graph and of the bodies of its loops.

    Attributes:
        nodes: of the graph, or of the body that is being built.
        constants: of all of them.
    """

    def __init__(self) -> None:
        self.nodes: list[NodeProto] = []
        self.constants: dict[str, TensorProto] = {}
        self._count = 0

    def name(self, kind: str) -> str:
        """A name that no other value has."""
        self._count += 1
        return f"{kind.lower()}.{self._count}"

    def add(self, kind: str, *inputs: str, **attributes: Any) -> str:
        """Append a node; the name of its output."""
        output = self.name(kind)
        self.nodes.append(helper.make_node(kind, list(inputs), [output], **attributes))
        return output

    def constant(self, value: Any) -> str:
        """Name of a constant; each stands once."""
        array = np.asarray(value)
        name = f"{array.dtype.name}.{array.shape}.{array.tobytes().hex()}" if array.size <= 4 else self.name("constant")
        self.constants.setdefault(name, numpy_helper.from_array(array, name))
        return name

    def operate(self, kind: str, *operands: Row | float) -> Row:
        """Row of an operator on rows and numbers."""
        names = [x.name if isinstance(x, Row) else self.constant(np.float64(x)) for x in operands]
        return Row(self, self.add(kind, *names))

    def choose(self, condition: Row | bool, one: Row | float, other: Row | float) -> Row | float:
        """Row by row, one where the condition holds, else the other."""
        if not isinstance(condition, Row):
            return one if condition else other
        return one if one is other else self.operate("Where", condition, _number(one), _number(other))

    def both(self, a: Row | bool, b: Row | bool) -> Row | bool:
        """Row by row, whether both hold."""
        if isinstance(a, Row) and isinstance(b, Row):
            return self.operate("And", a, b)
        one, other = (b, a) if isinstance(b, Row) else (a, b)
        return one if other else False

    def either(self, a: Row | bool, b: Row | bool) -> Row | bool:
        """Row by row, whether one of them holds."""
        return self.invert(self.both(self.invert(a), self.invert(b)))

    def invert(self, a: Row | bool) -> Row | bool:
        """Row by row, whether it does not hold."""
        return self.operate("Not", a) if isinstance(a, Row) else not a

    def loop(
        self, rounds: int, active: Row, values: list[Row], turn: Callable[[list[Row]], tuple[list[Any], Row | bool]]
    ) -> list[Row]:
        """Rows after a loop that ends when no row is active any more, or after the given number of rounds.

        Args:
            rounds: at most.
            active: rows that take part; what the others are stays.
            values: before the first round.
            turn: builds a round: values after it, and the rows that go on, from values before.
        """
        outer, self.nodes = self.nodes, []
        inside, here = [Row(self, self.name("carried")) for _ in values], Row(self, self.name("active"))
        after, going = turn(inside)
        left = self.both(here, going)
        kept = [self.choose(here, new, old) for new, old in zip(after, inside, strict=True)]
        ends = [self.add("Identity", x.name) for x in (left, *kept) if isinstance(x, Row)]
        some = self.any(left)
        truth, number = (TensorProto.BOOL, ["batch"]), (TensorProto.DOUBLE, ["batch"])
        one: list[tuple[int, list[str]]] = [(TensorProto.BOOL, [])]
        each = [truth, *[number] * len(values)]
        entries = [self.name("turn"), self.name("going"), here.name, *(x.name for x in inside)]
        body = helper.make_graph(
            self.nodes,
            self.name("body"),
            _infos(entries, [(TensorProto.INT64, []), *one, *each]),
            _infos([some, *ends], [*one, *each]),
        )
        self.nodes = outer
        results = [self.name("loop") for _ in ends]
        inputs = [self.constant(np.int64(rounds)), self.any(active), active.name, *(x.name for x in values)]
        self.nodes.append(helper.make_node("Loop", inputs, results, body=body))
        return [Row(self, name) for name in results[1:]]

    def any(self, truths: Row | bool) -> str:
        """Name of a number, whether any row holds."""
        assert isinstance(truths, Row)
        most = self.add("ReduceMax", self.add("Cast", truths.name, to=TensorProto.DOUBLE), keepdims=0)
        return self.add("Greater", most, self.constant(np.float64(0.0)))


def _infos(names: list[str], kinds: list[tuple[int, list[str]]]) -> list[ValueInfoProto]:
    return [helper.make_tensor_value_info(name, *kind) for name, kind in zip(names, kinds, strict=True)]


def _number(x: Row | float) -> Row | float:
    return x if isinstance(x, Row) else float(x)


class Row:
    """A number, or a truth, for each observation of the batch."""

    __array_ufunc__ = None  # numpy leaves the arithmetic to the row

    def __init__(self, builder: Builder, name: str) -> None:
        self.builder, self.name = builder, name

    def __add__(self, other: Row | float) -> Row:
        return self.builder.operate("Add", self, other)

    def __radd__(self, other: float) -> Row:
        return self.builder.operate("Add", other, self)

    def __sub__(self, other: Row | float) -> Row:
        return self.builder.operate("Sub", self, other)

    def __rsub__(self, other: float) -> Row:
        return self.builder.operate("Sub", other, self)

    def __mul__(self, other: Row | float) -> Row:
        return self.builder.operate("Mul", self, other)

    def __rmul__(self, other: float) -> Row:
        return self.builder.operate("Mul", other, self)

    def __truediv__(self, other: Row | float) -> Row:
        return self.builder.operate("Div", self, other)

    def __rtruediv__(self, other: float) -> Row:
        return self.builder.operate("Div", other, self)

    def __pow__(self, power: float) -> Row:
        if power == 0.5:
            return self.builder.operate("Sqrt", self)
        if power != 2:
            raise ValueError(f"a row has no power of {power}, only those of 2 and 0.5")
        return self * self

    def __rpow__(self, base: float) -> Row:
        return self.builder.operate("Pow", base, self)

    def __neg__(self) -> Row:
        return self.builder.operate("Neg", self)

    def __abs__(self) -> Row:
        return self.builder.operate("Abs", self)

    def __lt__(self, other: Row | float) -> Row:
        return self.builder.operate("Less", self, other)

    def __gt__(self, other: Row | float) -> Row:
        return self.builder.operate("Greater", self, other)

    def __le__(self, other: Row | float) -> Row:
        return self.builder.operate("LessOrEqual", self, other)

    def __ge__(self, other: Row | float) -> Row:
        return self.builder.operate("GreaterOrEqual", self, other)

    def __bool__(self) -> bool:
        raise TypeError("a row is no single truth")
