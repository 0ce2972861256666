"""Mistakes that can be put into a text of Python, each a piece of it and what stands there instead."""

import ast
from collections.abc import Iterator
from typing import NamedTuple

SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
# The limit itself on the other side: only where there are whole numbers, for two real ones are hardly ever equal
LIMITS: dict[type[ast.AST], type[ast.AST]] = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
SKIPPED = (ast.Import, ast.ImportFrom, ast.Raise, ast.Assert)  # no behaviour, or words and types of messages


class Mutation(NamedTuple):
    """A mistake: the line where it is, places of the piece in the text, and what stands there instead."""

    line: int
    begin: int
    end: int
    instead: str

    def of(self, text: str) -> str:
        """The text with the mistake."""
        return text[: self.begin] + self.instead + text[self.end :]


def mutations(text: str) -> Iterator[Mutation]:
    """All mistakes that can be put into a text: a comparison or an operation swapped, a condition turned round, a
    number changed, a statement left out."""
    starts = [0]
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    raw = text.encode()

    def place(line: int, column: int) -> int:
        return len(raw[: starts[line - 1] + column].decode())

    for node in _acting(ast.parse(text)):
        for other in _others(node):
            if node.end_lineno is None or node.end_col_offset is None:
                continue
            begin, end = place(node.lineno, node.col_offset), place(node.end_lineno, node.end_col_offset)
            yield Mutation(node.lineno, begin, end, other)


def _acting(node: ast.AST) -> Iterator[ast.expr | ast.stmt]:
    """What acts: all but annotations, messages, decorators and imports."""
    if isinstance(node, SKIPPED):
        return
    if isinstance(node, ast.expr | ast.stmt):
        yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "bases"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _acting(child)


def _others(node: ast.expr | ast.stmt) -> Iterator[str]:
    """What may stand in place of an expression or a statement."""
    match node:
        case ast.Constant(value):
            yield from _numbers(value)
        case ast.Compare() | ast.BinOp() | ast.BoolOp():
            yield from _operations(node)
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            yield _written(operand)
        case ast.IfExp(test, body, orelse):
            yield _written(ast.IfExp(ast.UnaryOp(ast.Not(), test), body, orelse))
        case ast.AugAssign(target, op, value) if type(op) in SWAPPED:
            yield ast.unparse(ast.AugAssign(target, SWAPPED[type(op)](), value))  # type: ignore[arg-type]
        case ast.Expr(ast.Call()) | ast.Assign([ast.Subscript() | ast.Attribute(), *_]):
            yield "pass"


def _numbers(value: object) -> Iterator[str]:
    match value:
        case bool():
            yield str(not value)
        case int():
            yield str(value + 1)
        case float():
            yield repr(2.0 * value if value else 1.0)


def _operations(node: ast.Compare | ast.BinOp | ast.BoolOp) -> Iterator[str]:
    match node:
        case ast.Compare(left, [op], [right]) if type(op) in SWAPPED:
            yield _written(ast.Compare(left, [SWAPPED[type(op)]()], [right]))  # type: ignore[list-item]
            if type(op) in LIMITS and (_counts(left) or _counts(right)):
                yield _written(ast.Compare(left, [LIMITS[type(op)]()], [right]))  # type: ignore[list-item]
        case ast.BinOp(left, op, right) if type(op) in SWAPPED and not _words(left):
            yield _written(ast.BinOp(left, SWAPPED[type(op)](), right))  # type: ignore[arg-type]
        case ast.BoolOp(op, values):
            yield _written(ast.BoolOp(SWAPPED[type(op)](), values))  # type: ignore[arg-type]


def _words(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def _counts(node: ast.expr) -> bool:
    match node:
        case ast.Constant(int()) | ast.Call(ast.Name("len"), _):
            return True
        case ast.BinOp(left, _, right):
            return _counts(left) or _counts(right)
    return False


def _written(node: ast.expr) -> str:
    return f"({ast.unparse(ast.fix_missing_locations(node))})"
