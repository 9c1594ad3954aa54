"""Tables of numbers as people, programs and instruments write them, and as nobody should."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

# names of columns whose scale is none of a unit in brackets or at the end
SCALED = """T_mK_mean|T x10^-3 (K)|10^3 T (K)|T*1000 [K]|T (K) *1000|T (K) (x0.001)|T [K] in mK|T millikelvin|T mk
T fahrenheit|T_F|T mVolts|TmK|T (K) E-3|shift_pm|counts""".replace("\n", "|").split("|")
SCALED_TIMES = ["t msec", "Millisekunden", "t_min", "h", "US", "t (s) E-6", "10^6 t (s)"]


def scaled_names(rows: list[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    """Tables of two columns, one of which has such a name."""
    table = "\n".join(",".join(row) for row in rows)
    for name in SCALED:
        yield name, f"time (us),{name}\n{table}\n"
    for name in SCALED_TIMES:
        yield name, f"{name},T (K)\n{table}\n"


def headers(rows: list[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    """Tables of times in us and temperatures in mK whose header is divided in another way than their rows."""
    heads = [f"{{}}time (us){d}T (mK)" for d in (",", ", ", ";", "; ", "\t", "   ", " | ", "|", ": ")]
    heads += ["{}time(us) T(mK)", '{}"time (us)","T (mK)"', "{}time_us, T_mK", "{}time [us], T [mK], run"]
    heads += [f"{{0}}time{d}T\n{{0}}us{d}mK" for d in (",", ";", "\t", "|")]
    heads += [f"{{}}time{w}us, T{w}mK" for w in ("/", " / ", " in ", " ", "_")]
    heads += ["{}time {{us}}, T {{mK}}", "{}time <us>, T <mK>", "{}t (us), T_mK_mean"]
    for head in heads:
        for divider in (",", ", ", ";", "\t", " "):
            for mark in ("", "# "):
                table = "\n".join(divider.join(row) for row in rows)
                yield f"{head!r} above {divider!r}", f"{head.format(mark)}\n{table}\n"


def odd_headers(rows: list[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    """The same with comment marks of other programs, and below what instruments write, with a cell for each column."""
    heads = [f"{{0}}time{d}T\n{{0}}us{d}mK" for d in (",", ";", "\t")] + ["{0}time (us);T (mK)", "{0}time[us]\tT [mK]"]
    heads += ["{0}t / us T / mK", "{0}t in us T in mK", "{0}t us T mK"]
    above = ("", "Time offset [us],0\n", "Segments,1,41\n", "Probe attenuation (V),10\n", "Model,MSO24\n")
    for lines, head, mark in itertools.product(above, heads, ("", "# ", "//", "! ", "'")):
        for divider in (",", ";", "\t", " ", ";;"):
            end = divider[1:]  # an empty column
            table = "\n".join(divider[0].join(row) + end for row in rows)
            yield f"{lines!r} {head!r} {mark!r} above {divider!r}", f"{lines}{head.format(mark)}\n{table}\n"


def mixed(rows: list[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    """Tables whose separator is another one from some row on."""
    dividers = (",", ";", "\t", " ", "|")
    for first in dividers:
        for then in dividers:
            for k in (1, 5, len(rows) // 2, len(rows) - 1) if then != first else ():
                lines = [first.join(row) for row in rows[:k]] + [then.join(row) for row in rows[k:]]
                yield f"{first!r} then {then!r} from {k}", "\n".join(["time (us),T (mK)", *lines])
