"""C source of SX functions in small pieces, with the interface of `casadi.external`.

A compiler's time grows faster than the length of a function, and most of it goes into values that
live long. So the operations, in their order, are cut into functions of `PIECE` each; values that
cross a cut wait in memory. Text of several files can be compiled side by side. The operations are
those of CasADi's virtual machine, one by one, and give the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

#: Operations of a C function, and of a file.
PIECE, FILE = 120, 4000

_FORMS = {
    ca.OP_ADD: "{}+{}",
    ca.OP_SUB: "{}-{}",
    ca.OP_MUL: "{}*{}",
    ca.OP_DIV: "{}/{}",
    ca.OP_NEG: "-{}",
    ca.OP_INV: "1./{}",
    ca.OP_SQ: "{0}*{0}",
    ca.OP_TWICE: "2.*{}",
    ca.OP_SQRT: "sqrt({})",
    ca.OP_SIN: "sin({})",
    ca.OP_COS: "cos({})",
    ca.OP_TANH: "tanh({})",
}
_START = "#include <math.h>\n#include <string.h>\ntypedef long long I;typedef const double*R;\n"
_ARGUMENTS = "(const R*x,double*const*r,double*w)"
_ENTRY = """
X I {name}_n_in(void){{return {n_in};}}
X I {name}_n_out(void){{return {n_out};}}
static const I i{name}[]={{{shapes_in}}},o{name}[]={{{shapes_out}}};
X const I*{name}_sparsity_in(I i){{return i{name}+3*i;}}
X const I*{name}_sparsity_out(I i){{return o{name}+3*i;}}
X int {name}_work(I*a,I*r,I*i,I*w){{*a={n_in};*r={n_out};*i=0;*w={memory};return 0;}}
X int {name}(const R*x,double**r,I*i,double*w,int m){{
R a[]={{{inputs}}};double*b[]={{{outputs}}};
{calls}return 0;}}
"""


def c_files(functions: Sequence[ca.Function]) -> list[str] | None:
    """The text of the files that make a library, None where an operation has no form here.

    Inputs and outputs are dense columns; one that is not given is 0, one not wanted is dropped.
    """
    files, pieces, entries = (
        list[str](),
        list[str](),
        [_START + '#define X __attribute__((visibility("default")))'],
    )
    room = FILE
    for function in functions:
        cut = _pieces(function)
        if cut is None:
            return None
        entries.append(_entry(function, *cut))
        for piece in cut[0]:
            pieces.append(piece)
            room -= PIECE
            if room <= 0:
                files.append(_START + "".join(pieces))
                pieces, room = [], FILE
    return [*files, _START + "".join(pieces), "".join(entries)]


def _entry(function: ca.Function, pieces: list[str], crossing: int) -> str:
    """What `casadi.external` calls: all pieces one after the other."""
    name, ins, outs = function.name(), function.n_in(), function.n_out()
    sizes = [function.nnz_in(i) for i in range(ins)], [function.nnz_out(i) for i in range(outs)]
    spare = crossing + max([*sizes[0], 0])
    drops = [spare + sum(sizes[1][:i]) for i in range(outs)]
    calls = "".join(f"{name}_{i}(a,b,w);\n" for i in range(len(pieces)))
    zero = f"memset(w+{crossing},0,sizeof(double)*{spare - crossing});\n"
    text = _ENTRY.format(
        name=name,
        n_in=ins,
        n_out=outs,
        shapes_in=",".join(f"{size},1,1" for size in sizes[0]),
        shapes_out=",".join(f"{size},1,1" for size in sizes[1]),
        memory=spare + sum(sizes[1]),
        inputs=",".join(f"x[{i}]?x[{i}]:w+{crossing}" for i in range(ins)),
        outputs=",".join(f"r[{i}]?r[{i}]:w+{drop}" for i, drop in enumerate(drops)),
        calls=zero + calls,
    )
    declared = "".join(f"void {name}_{i}{_ARGUMENTS};" for i in range(len(pieces)))
    return "\n" + declared + text


def _pieces(function: ca.Function) -> tuple[list[str], int] | None:
    """The text of the pieces, and how many values cross a cut."""
    lines: list[tuple[int, str, tuple[int, ...]]] = []
    holds: dict[int, int] = {}
    for i in range(function.n_instructions()):
        kind = function.instruction_id(i)
        reads, writes = function.instruction_input(i), function.instruction_output(i)
        used: tuple[int, ...] = ()
        if kind == ca.OP_INPUT:
            form = f"x[{reads[0]}][{reads[1]}]"
        elif kind == ca.OP_CONST:
            form = repr(float(function.instruction_constant(i)))
        elif kind == ca.OP_OUTPUT:
            form, used = f"r[{writes[0]}][{writes[1]}]=" + "{};", (holds[reads[0]],)
        elif kind in _FORMS:
            form, used = _FORMS[kind], tuple(holds[k] for k in reads)
        else:
            return None
        if kind != ca.OP_OUTPUT:
            holds[writes[0]] = i
        lines.append((-1 if kind == ca.OP_OUTPUT else i, form, used))
    crossing = {k for i, (_, _, used) in enumerate(lines) for k in used if k // PIECE != i // PIECE}
    slot = {k: place for place, k in enumerate(sorted(crossing))}
    pieces = list[str]()
    for start in range(0, len(lines), PIECE):
        text, here = [f"void {function.name()}_{len(pieces)}{_ARGUMENTS}{{"], set[int]()
        for value, form, used in lines[start : start + PIECE]:
            for k in used:
                if k < start and k not in here:
                    text.append(f"double a{k}=w[{slot[k]}];")
                    here.add(k)
            line = form.format(*[f"a{k}" for k in used])
            text.append(line if value < 0 else f"double a{value}={line};")
            if value in crossing:
                text.append(f"w[{slot[value]}]=a{value};")
        pieces.append("\n".join([*text, "}\n"]))
    return pieces, len(slot)
