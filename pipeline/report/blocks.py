"""What the page of a report is made of: texts, tables, pictures, and templates that place them."""

from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from hbm.notes import Note, warnings_of
from hbm.spelling import join_names
from pipeline.io.write import write_text

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

Check = tuple[str, str, str]
"""A cell that is rated: "pass", "check" (to be looked at), "fail" (outside a published limit) or
"none" (no limit); the value; what it consists of, such as the worst marker."""


class Interval(NamedTuple):
    """A cell that is drawn: places of low end, middle, high end, 0 and 100 %; the same in words."""

    places: Sequence[str]
    text: str


@dataclass(frozen=True, slots=True)
class Text:
    """A heading or lead, and lines below it."""

    lead: str
    lines: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Table:
    """A table; the first column names the rows, the other cells are texts or rated findings."""

    caption: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str | Interval | Sequence[Check]]]
    css_class: str = ""
    legend: str = ""
    links: Mapping[str, str] = field(default_factory=dict)
    """Name of a row -> address that it links to."""


def table_of(
    caption: str,
    columns: Mapping[str, Callable[[Any], str | Sequence[Check]]],
    rows: Iterable[Any],
) -> Table:
    """Lay out a table, a row for each of some things: head -> what is written of a thing."""
    cells = [[write(row) for write in columns.values()] for row in rows]
    return Table(caption, [*columns], cells, "numbers")


class Drawn(NamedTuple):
    """A figure as a source inside the page, with its caption."""

    caption: str
    source: str


Block = str | Text | Table | Drawn | Note
"""A sentence, or markup; lines; a table; a figure; a warning."""


class Section(NamedTuple):
    """A part of a page: its name in the list of sections, its heading, and what is below."""

    name: str
    title: str
    blocks: Sequence[Block]
    folded: bool = False


def write_page(
    path: Path, name: str, scope: str, sections: Iterable[Section], study: str = "", key: str = ""
) -> Path:
    """Write a page: name, scope, and each section that has something below its heading.

    With a link to its study's page, where there is one; the key is a comment at the end.
    """
    shown = [section for section in sections if any(section.blocks)]
    text = markup("page.js")
    digest = b64encode(sha256(text.encode()).digest()).decode()  # all that the browser runs
    script = {"text": text, "digest": f"sha256-{digest}"}
    values = {"name": name, "scope": scope, "sections": shown, "study": study, "script": script}
    page = markup("page.html", **values)
    write_text(f"{page}\n{key}", path)
    return path


@cache
def templates() -> "Environment":
    """Give the templates of pages and their parts."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("pipeline.report"),
        autoescape=lambda name: name is None or not name.endswith(".txt"),  # text is no markup
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {"in_unit": in_unit, "names": join_names, "each": each, "words": words}
    made.filters["warnings"] = warnings_of
    return made


def markup(template: str, **values: Any) -> "Markup":
    """Fill the template of a page, or of a part of one."""
    from markupsafe import Markup

    return Markup(templates().get_template(template).render(values).strip())


def each(texts: Iterable[object]) -> str:
    """Name each of some texts once, as in a sentence."""
    return join_names(sorted(set(map(str, texts))))


def words(keys: Iterable[str], texts: Mapping[str, str]) -> list[str]:
    """Say in words those of some keys that are known."""
    present = set(keys)
    return [text for key, text in texts.items() if key in present]


def in_unit(values: Iterable[float | None], factor: float, form: str = "%g") -> list[str]:
    """Write different numbers once each, in another unit; None is zero."""
    return [form % (factor * value) for value in sorted({value or 0.0 for value in values})]
