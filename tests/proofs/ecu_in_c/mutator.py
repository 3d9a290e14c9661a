"""C in which every small fault is built in at once, and an integer chooses the one that acts.

A source is parsed by pycparser and written out again. Beside an expression that could be wrong stands the wrong one,
`(sw_mutant == 17 ? a <= b : a < b)`; so hundreds of mutants cost one compilation, and a mutant is chosen at run time.

What is mutated: relations, arithmetic, shifts and bits, logic, conditions, constants by one, signs, increments;
statements are left out; rows and entries of constant tables are changed. What is not: declarations, sizes, `case`
labels, and the constants inside a `sizeof`. Every loop asks for fuel, so that a mutant which never ends does end.
"""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from pycparser import c_ast, c_generator, c_parser

OPERATORS: Final = {
    "<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="), ">=": (">", "<"), "==": ("!=",), "!=": ("==",),
    "&&": ("||",), "||": ("&&",), "+": ("-",), "-": ("+",), "*": ("+",), "/": ("*",), "%": ("*",),
    "<<": (">>",), ">>": ("<<",), "&": ("|",), "|": ("&",), "^": ("|",),
    "+=": ("-=",), "-=": ("+=",), "|=": ("&=", "="), "&=": ("|=", "="), "^=": ("=",), "=": (),
}  # fmt: skip
"""What each is exchanged for."""
SUPPORT: Final = """
int sw_mutant = 0;
long sw_fuel_left = 0;
int sw_fuel(void);
int sw_fuel(void) { return sw_fuel_left-- > 0; }
"""
_EXTERNAL: Final = "extern int sw_mutant;\nextern int sw_fuel(void);\n"
MODES: Final = ("INIT", "STANDBY", "ARMED", "WARMUP", "CONTROL", "HOLD", "DECAY", "FAULT", "UPDATE")
_LEFT_OUT: Final = (c_ast.Assignment, c_ast.FuncCall, c_ast.Break, c_ast.Continue, c_ast.UnaryOp)


class Mutant(NamedTuple):
    """One fault, which acts if `sw_mutant` has its number. Its place is file, line, and which of the line's mutants it
    is; without its number it is the same in every library that has its line."""

    number: int
    place: tuple[str, int, int]
    text: str

    def __str__(self) -> str:
        file, line, nth = self.place
        return f"{file}:{line}.{nth}: {self.text}"


def mutated(name: str, preprocessed: str, first: int) -> tuple[str, list[Mutant]]:
    """A preprocessed source with line markers, as C with its mutants, which are numbered from `first` on;
    `sw_mutate_NAME()` changes its tables."""
    tree = c_parser.CParser().parse(preprocessed, name)
    generator = _Generator(name, first)
    text = _EXTERNAL + generator.visit(tree)
    stem = name.removesuffix(".c")
    cases = "\n".join(f"    if (sw_mutant == {number}) {change};" for number, change in generator.changes)
    text += f"\nvoid sw_mutate_{stem}(void);\nvoid sw_mutate_{stem}(void)\n{{\n{cases}\n}}\n"
    return text, generator.mutants


class _Generator(c_generator.CGenerator):  # type: ignore[misc] # pycparser has no types
    def __init__(self, file: str, first: int) -> None:
        super().__init__()
        self.mutants: list[Mutant] = []
        self.changes: list[tuple[int, str]] = []
        self._plain = c_generator.CGenerator()
        self._file, self._first = file, first
        self._line, self._nth = 0, 0
        self._inside = False
        self._structs: dict[str, list[str]] = {}

    def _mutant(self, node: Any, before: str, after: str) -> int:
        line = node.coord.line if node.coord is not None else self._line
        self._nth = self._nth + 1 if line == self._line else 1
        self._line = line
        number = self._first + len(self.mutants)
        self.mutants.append(Mutant(number, (self._file, line, self._nth), f"`{before}` becomes `{after}`"))
        return number

    def _acts(self, node: Any) -> bool:
        return self._inside and node.coord is not None and node.coord.file.endswith(self._file)

    def _either(self, node: Any, before: str, others: list[str], text: str) -> str:
        for other in others:
            text = f"(sw_mutant == {self._mutant(node, before, other)} ? ({other}) : ({text}))"
        return text

    def visit_BinaryOp(self, n: Any) -> str:
        mutated_text = f"({self.visit(n.left)} {n.op} {self.visit(n.right)})"
        if not self._acts(n):
            return mutated_text
        left, right = f"({self._plain.visit(n.left)})", f"({self._plain.visit(n.right)})"
        others = [f"{left} {other} {right}" for other in OPERATORS[n.op]]
        if n.op in ("&&", "||"):
            others += [left, right]
        return self._either(n, self._plain.visit(n), others, mutated_text)

    def visit_UnaryOp(self, n: Any) -> str:
        if n.op == "sizeof":
            return str(self._plain.visit(n))
        if n.op == "&":
            # An address is of what stands there; an index within may still be wrong.
            return f"&{self.visit(n.expr)}" if isinstance(n.expr, c_ast.ID) else f"&({self.visit(n.expr)})"
        text = str(super().visit_UnaryOp(n))
        if self._acts(n) and n.op in ("!", "-", "~"):
            return self._either(n, self._plain.visit(n), [f"({self._plain.visit(n.expr)})"], text)
        return text

    def visit_Constant(self, n: Any) -> str:
        text = str(super().visit_Constant(n))
        if not self._acts(n) or n.type in ("string", "char"):
            return text
        return self._either(n, text, [f"({text} + 1)", f"({text} - 1)"], text)

    def visit_TernaryOp(self, n: Any) -> str:
        return f"({self._condition(n, n.cond)} ? ({self.visit(n.iftrue)}) : ({self.visit(n.iffalse)}))"

    def _condition(self, node: Any, cond: Any) -> str:
        text, plain = f"({self.visit(cond)})", self._plain.visit(cond)
        return self._either(node, plain, [f"!({plain})"], text) if self._acts(node) else text

    def visit_If(self, n: Any) -> str:
        text = f"if ({self._condition(n, n.cond)})\n{self._block(n.iftrue)}"
        if n.iffalse is not None:
            text += f"{self._make_indent()}else\n{self._block(n.iffalse)}"
        return text

    def visit_For(self, n: Any) -> str:
        init = self.visit(n.init) if n.init is not None else ""
        cond = self._condition(n, n.cond)
        after = self._plain.visit(n.next) if n.next is not None else ""
        return f"for ({init}; sw_fuel() && {cond}; {after})\n{self._block(n.stmt)}"

    def visit_While(self, n: Any) -> str:
        return f"while (sw_fuel() && {self._condition(n, n.cond)})\n{self._block(n.stmt)}"

    def visit_DoWhile(self, n: Any) -> str:
        return f"do\n{self._block(n.stmt)}while (sw_fuel() && {self._condition(n, n.cond)});"

    def _block(self, node: Any) -> str:
        """A body in braces: what is put in front of a statement must not catch the next `else`."""
        inner = self._generate_stmt(node, add_indent=True)
        return inner if isinstance(node, c_ast.Compound) else f"{{\n{inner}}}\n"

    def _generate_stmt(self, n: Any, add_indent: bool = False) -> str:
        text = str(super()._generate_stmt(n, add_indent))
        if not self._acts(n) or not isinstance(n, _LEFT_OUT):
            return text
        plain = self._plain.visit(n).rstrip(";")
        others = []
        if isinstance(n, c_ast.Assignment):
            left, right = self._plain.visit(n.lvalue), self._plain.visit(n.rvalue)
            others = [f"{left} {other} {right}" for other in OPERATORS.get(n.op, ())]
        if isinstance(n, c_ast.UnaryOp):
            swaps = {"p++": "--", "p--": "++", "++": "--", "--": "++"}
            others = [f"{self._plain.visit(n.expr)}{swaps[n.op]}"] if n.op in swaps else []
        text = f"if (sw_mutant != {self._mutant(n, plain, '')})\n{{\n{text}}}\n"
        for other in others:
            text = f"if (sw_mutant == {self._mutant(n, plain, other)}) {{ {other}; }} else {{\n{text}}}\n"
        return text

    def visit_ArrayDecl(self, n: Any, *arguments: Any) -> str:
        return str(self._plain.visit_ArrayDecl(n, *arguments))

    def visit_Cast(self, n: Any) -> str:
        return f"({self._plain.visit(n.to_type)})({self.visit(n.expr)})"

    def visit_Case(self, n: Any) -> str:
        text = f"case {self._plain.visit(n.expr)}:\n"
        return text + "".join(self._generate_stmt(item, add_indent=True) for item in n.stmts or ())

    def visit_NamedInitializer(self, n: Any) -> str:
        names = "".join(f".{one.name}" if isinstance(one, c_ast.ID) else str(self._plain.visit(one)) for one in n.name)
        return f"{names} = {self._visit_expr(n.expr)}"

    def visit_FuncDef(self, n: Any) -> str:
        self._inside, self.indent_level = True, 0
        text = f"{self._plain.visit(n.decl)}\n{self.visit(n.body)}\n"
        self._inside = False
        return text

    def visit_Typedef(self, n: Any) -> str:
        kind = n.type.type if isinstance(n.type, c_ast.TypeDecl) else None
        if isinstance(kind, c_ast.Struct) and kind.decls:
            self._structs[n.name] = [item.name for item in kind.decls]
        return str(self._plain.visit_Typedef(n))

    def visit_Decl(self, n: Any, no_type: bool = False) -> str:
        if n.init is None or not isinstance(n.init, c_ast.InitList):
            if self._inside and "static" not in n.storage:
                return str(super().visit_Decl(n, no_type))
            return str(self._plain.visit_Decl(n, no_type))
        if self._inside:
            # Not static any more, a table may hold numbers that are chosen when it is used.
            n.storage = [item for item in n.storage if item != "static"]
            declared = self._plain._generate_decl(n)
            return f"{declared} = {{{self.visit_InitList(n.init)}}}"
        if n.coord is not None and n.coord.file.endswith(self._file):
            self._table(n)
        return str(self._plain.visit_Decl(n, no_type))

    def visit_InitList(self, n: Any) -> str:
        return ", ".join(self._visit_expr(item) for item in n.exprs)

    def _visit_expr(self, n: Any, *arguments: Any, **options: Any) -> str:
        if isinstance(n, c_ast.InitList):
            return f"{{{self.visit_InitList(n)}}}"
        return str(super()._visit_expr(n, *arguments, **options))

    def _table(self, n: Any) -> None:
        """Mutants of a constant table of the file: its entries, changed before anything runs."""
        _drop_const(n)
        kind = n.type.type.type.names[-1] if isinstance(n.type, c_ast.ArrayDecl) else ""
        fields = self._structs.get(kind, [])
        for index, row in enumerate(n.init.exprs):
            is_struct = isinstance(row, c_ast.InitList)
            for field, entry in zip(fields, row.exprs, strict=True) if is_struct else [("", row)]:
                path, text = f"{n.name}[{index}].{field}".rstrip("."), self._plain.visit(entry)
                others = [f"({text}) + 1", f"({text}) - 1"]
                if field == "start":
                    # A mode left out, of those that are in: the others are in the rows before or after.
                    others = [f"({text}) & ~(1u << (unsigned)SW_{mode})" for mode in MODES if f"SW_{mode})" in text]
                for other in others:
                    self.changes.append((self._mutant(entry, f"{path} = {text}", other), f"{path} = {other}"))


def _drop_const(node: Any) -> None:
    node.quals = [item for item in node.quals if item != "const"]
    inner = node.type
    while inner is not None and not isinstance(inner, c_ast.IdentifierType):
        if hasattr(inner, "quals"):
            inner.quals = [item for item in inner.quals if item != "const"]
        inner = getattr(inner, "type", None)


def all_mutated(preprocessed: Mapping[str, str]) -> tuple[dict[str, bytes], list[Mutant]]:
    """Mutated sources by name with what else they need, and all their mutants, numbered from 1."""
    sources, mutants = dict[str, bytes](), list[Mutant]()
    for name, text in preprocessed.items():
        changed, found = mutated(name, text, 1 + len(mutants))
        sources[name] = changed.encode()
        mutants += found
    calls = [f"sw_mutate_{name.removesuffix('.c')}" for name in preprocessed]
    declared = "".join(f"void {call}(void);\n" for call in calls)
    body = "".join(f"    {call}();\n" for call in calls)
    support = f"{SUPPORT}{declared}void sw_mutate(void);\nvoid sw_mutate(void)\n{{\n{body}}}\n"
    return sources | {"mutants.c": support.encode()}, mutants
