"""report.html from its template: one file that needs nothing else, right on a phone and on paper.

``{study/path/to/number|factor|format}`` in the template is a number, times a factor, in a format; with ``|low..high``
at its end its row of the table agrees only where the number, as shown, lies between the two.

A number that was not found is a dash, never a missing row. What needs a study that the short version does not compute
is left out of that version.
"""

import base64
import html
import re
from pathlib import Path

import thermofem as th

from .study import STUDIES

PLACE = re.compile(r"\{([^{}|]+)\|([^{}|]*)\|([^{}|]*)(?:\|([^{}|]+)\.\.([^{}|]+))?\}")
CELL = r"<td>(.*?)</td>\s*"
WHERE = r'(<span\s+class="where">.*?</span>)?'
ROW = re.compile(rf'<tr><td>(.*?){WHERE}</td>\s*{CELL}{CELL}{CELL}</tr>', re.S)
SECTION = re.compile(r"<section.*?</section>", re.S)
FIGURE = re.compile(r'<figure id="(\w+)"><h3>(.*?)</h3>(.*?)</figure>', re.S)
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def page(results, pictures, explorer, quick):
    """The report, and the rows of its table for programs."""
    asked = {name for name, study in STUDIES.items() if study.quick or not quick}
    paper, other = (Path(__file__).parent / "report.html").read_text(encoding="utf-8").split("<h3>The same equations")
    rows = []
    paper = ROW.sub(lambda match: row(match, results, asked, "the paper", rows), paper)
    other = ROW.sub(lambda match: row(match, results, asked, "the other code", rows), other)

    def section(match):
        body = FIGURE.sub(lambda m: picture(m, pictures), match[0])
        empty = 'class="panels"' in body and "<img" not in body
        return "" if empty or ('class="quick"' in body and not quick) or left_out(body, asked) else body

    text = SECTION.sub(section, f"{paper}<h3>The same equations{other}")
    text = re.sub(r'<p class="lead">.*?</p>', lambda m: "" if left_out(m[0], asked) else m[0], text, flags=re.S)
    text = PLACE.sub(lambda m: marked(m, results), text)
    links = re.findall(r'<section id="([^"]+)"[^>]*><h2>(.*?)</h2>', text)[1:]
    parts = {
        "contents": "".join(f'<a href="#{name}">{title}</a> ' for name, title in links),
        "explorer": "data:text/html;charset=utf-8;base64," + base64.b64encode(explorer.encode()).decode(),
        "data": "".join(files(STUDIES[name].words, result) for name, result in results.items()),
        "seconds": f"{sum(result.seconds for result in results.values()):.0f}",
        "version": th.__version__,
    }
    for name, part in parts.items():
        text = text.replace(f"<!-- {name} -->", part)
    return text, rows


def row(match, results, asked, who, rows):
    """A row of the table with its verdict, also appended to ``rows``; with a dash for a number that is not there."""
    quantity, where, says, ours, why = match.groups(default="")
    if left_out(ours + why, asked):
        return ""
    agrees = verdict(ours, results)
    absent = missing(ours + why, results)
    texts = {"where": where or "independent code", "quantity": quantity, "paper": says, "ours": ours, "why": why}
    shown_texts = {name: plain(text, results) for name, text in texts.items()}
    rows.append({**shown_texts, "agrees": agrees, "missing": absent})
    kind, words = {True: ("agrees", "agrees"), False: ("differs", "differs"), None: ("open", "–")}[agrees]
    if absent:
        kind, words = "differs", "no number"
    return (
        f'<tr><td>{quantity}{where}</td><td data-label="{who}">{says}</td><td data-label="we get">{ours}</td>'
        f'<td class="tight {kind}">{words}</td><td class="soft">{why}</td></tr>'
    )


def verdict(text, results):
    """Whether every number of a text lies in its range; None without ranges, or where a number is not there."""
    tests = [match for match in PLACE.finditer(text) if match[4]]
    if not tests or missing(text, results):
        return None
    values = [number(results, match[1]) * float(match[2] or 1) for match in tests]
    return all(float(match[4]) <= value <= float(match[5]) for match, value in zip(tests, values, strict=True))


def picture(match, pictures):
    """A figure with its panel, or nothing where that was not drawn."""
    name, title, rest = match.groups()
    if name not in pictures:
        return ""
    image, words = base64.b64encode(pictures[name]).decode(), html.escape(re.sub("<.*?>", "", title))
    source = f'<img alt="{words}" src="data:image/svg+xml;base64,{image}">'
    return f'<figure id="{name}"><h3>{title}</h3>{source}{rest}</figure>'


def number(results, path):
    """The number at ``study/path/to/number``, list items counted from 0; None where there is none."""
    name, *rest = " ".join(path.split()).split("/")
    value = results[name].numbers if name in results else None
    for step in rest:
        if isinstance(value, list):
            value = value[int(step)] if int(step) < len(value) else None
        elif value is not None:
            value = value.get(step)
    return value


def missing(text, results):
    """The numbers of a text that were not found, as ``study/path/to/number``."""
    paths = [" ".join(match[1].split()) for match in PLACE.finditer(text)]
    return [path for path in paths if number(results, path) is None]


def left_out(text, asked):
    """Whether a text has a number of a study that is not among those asked for."""
    return any(" ".join(match[1].split()).partition("/")[0] not in asked for match in PLACE.finditer(text))


def shown(value, factor, style):
    """A number as a person reads it: 6·10⁻⁵, not 6e-05; a dash where there is none."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    digits, _, exponent = format(value * float(factor or 1), style).partition("e")
    return digits.replace("-", "−") + (f"·10{str(int(exponent)).translate(RAISED)}" if exponent else "")


def marked(match, results):
    """A number as a <data> element that names its file; a dash where there is none."""
    name, _, pointer = " ".join(match[1].split()).partition("/")
    value = number(results, match[1])
    if value is None:
        return "–"
    source = html.escape(f"{results[name].files[0]}#/numbers/{pointer}")
    attributes = f'value="{html.escape(repr(value))}" data-from="{source}" data-factor="{match[2] or 1}"'
    return f'<data {attributes} title="{source}">{html.escape(shown(value, match[2], match[3]))}</data>'


def plain(text, results):
    """A text of the template without tags, with its numbers in place."""
    text = PLACE.sub(lambda m: shown(number(results, m[1]), m[2], m[3]), " ".join(text.split()))
    return html.unescape(re.sub("<.*?>", "", re.sub(r"<sub>(.*?)</sub>", r"_\1", text)))


def files(words, result):
    """Links to the files of a result, with the CPU time that it took when it was computed."""
    links = ", ".join(f'<a href="{html.escape(path)}">{html.escape(Path(path).name)}</a>' for path in result.files)
    seconds = f'data-label="CPU time">{result.seconds:.1f} s'
    return f'<tr><td>{html.escape(words)}</td><td>{links}</td><td class="tight" {seconds}</td></tr>'
