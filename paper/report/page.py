"""report.html from its template: one file that needs nothing else, right on a phone and on paper.

``{study/path/to/number|factor|format}`` in the template is a number, times a factor, in a format; with ``|low..high``
at its end its row of the table agrees only where the number, as shown, lies between the two.
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
    paper, other = (Path(__file__).parent / "report.html").read_text(encoding="utf-8").split("<h3>The same equations")
    rows = []
    paper = ROW.sub(lambda match: row(match, results, "the paper", rows), paper)
    other = ROW.sub(lambda match: row(match, results, "the other code", rows), other)

    def section(match):
        body = FIGURE.sub(lambda m: picture(m, pictures), match[0])
        empty = 'class="panels"' in body and "<img" not in body
        return "" if empty or ('class="quick"' in body and not quick) or not known(body, results) else body

    text = SECTION.sub(section, f"{paper}<h3>The same equations{other}")
    text = re.sub(r'<p class="lead">.*?</p>', lambda m: m[0] if known(m[0], results) else "", text, flags=re.S)
    text = PLACE.sub(lambda m: marked(m, results), text)
    links = [*re.findall(r'<section id="([^"]+)"[^>]*><h2>(.*?)</h2>', text)[1:], ("data", "Data")]
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


def row(match, results, who, rows):
    """A row of the table with its verdict, also appended to ``rows``; nothing where a number of it was not computed."""
    quantity, where, says, ours, why = match.groups(default="")
    if not known(ours + why, results):
        return ""
    tests = [(float(m[4]), number(results, m[1]) * float(m[2] or 1), float(m[5])) for m in PLACE.finditer(ours) if m[4]]
    agrees = all(low <= value <= high for low, value, high in tests) if tests else None
    texts = {"where": where or "independent code", "quantity": quantity, "paper": says, "ours": ours, "why": why}
    rows.append({name: plain(text, results) for name, text in texts.items()} | {"agrees": agrees})
    kind, words = {True: ("agrees", "agrees"), False: ("differs", "differs"), None: ("open", "–")}[agrees]
    return (
        f'<tr><td>{quantity}{where}</td><td data-label="{who}">{says}</td><td data-label="we get">{ours}</td>'
        f'<td class="tight {kind}">{words}</td><td class="soft">{why}</td></tr>'
    )


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
        if value is not None:
            value = value[int(step)] if isinstance(value, list) else value[step]
    return value


def known(text, results):
    """Whether every number in a text was computed."""
    return all(number(results, m[1]) is not None for m in PLACE.finditer(text))


def shown(value, factor, style):
    """A number as a person reads it: 6·10⁻⁵, not 6e-05."""
    if isinstance(value, str):
        return value
    digits, _, exponent = format(value * float(factor or 1), style).partition("e")
    return digits.replace("-", "−") + (f"·10{str(int(exponent)).translate(RAISED)}" if exponent else "")


def marked(match, results):
    """A number as a <data> element that names its file."""
    name, _, pointer = " ".join(match[1].split()).partition("/")
    value, source = number(results, match[1]), html.escape(f"{results[name].files[0]}#/numbers/{pointer}")
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
