"""Named expressions of a parameter file, evaluated without running them as a program."""

import ast
import operator
from collections.abc import Callable, Iterator, Mapping
from math import pi, sqrt

OPERATORS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
Value = float | list[float]


class Expressions(Mapping[str, float]):
    """Named expressions that may use each other: numbers, lists (1-based), + - * / ^, sqrt, pi; nothing else.

    `expressions["name"]` is a number, `expressions.several("name")` a list of numbers. ValueError names an expression
    that is missing, refers to itself, cannot be read or is not of that kind."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self.texts = texts
        self.open: list[str] = []

    def __iter__(self) -> Iterator[str]:
        return iter(self.texts)

    def __len__(self) -> int:
        return len(self.texts)

    def __getitem__(self, name: str) -> float:
        return number(self.named(name))

    def several(self, name: str) -> list[float]:
        """The numbers of a list."""
        return numbers(self.named(name))

    def named(self, name: str) -> Value:
        """Value of the expression of that name."""
        if name == "pi":
            return pi
        if name in self.open or name not in self.texts:
            raise ValueError(f"{name} {'refers to itself' if name in self.open else 'is missing'}")
        self.open.append(name)
        try:
            return self.value(ast.parse(self.texts[name].replace("^", "**"), mode="eval").body)
        except SyntaxError as error:
            raise ValueError(f"{name} is no expression: {self.texts[name]!r}") from error
        finally:
            self.open.pop()

    def value(self, node: ast.expr) -> Value:
        """Value of a parsed expression. Raises ValueError for anything that is not listed above."""
        match node:
            case ast.Constant(value=int() | float() as found):
                return float(found)
            case ast.Name(id=name):
                return self.named(name)
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                return -number(self.value(inner))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                return OPERATORS[type(op)](number(self.value(left)), number(self.value(right)))
            case ast.List(elts=parts):
                return [number(self.value(part)) for part in parts]
            case ast.Call(func=ast.Name(id=name), args=[inner], keywords=[]):
                argument = number(self.value(inner))
                return sqrt(argument) if name == "sqrt" else self.several(name)[int(argument) - 1]
        raise ValueError(f"{ast.unparse(node)!r} is beyond what is evaluated here")


def number(value: Value) -> float:
    """The value, which has to be one number."""
    if isinstance(value, list):
        raise ValueError(f"{value} is a list where a number is expected")
    return value


def numbers(value: Value) -> list[float]:
    """The value, which has to be a list."""
    if not isinstance(value, list):
        raise ValueError(f"{value} is a number where a list is expected")
    return value
