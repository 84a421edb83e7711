"""HTML as a tree of elements: whatever a person typed is text, never markup."""

from collections.abc import Sequence
from typing import Any
from xml.etree.ElementTree import Element, tostring

Content = Element | str


def element(tag: str, *content: Content, **attributes: Any) -> Element:
    """Make an element.

    Parameters
    ----------
    tag
        Its name.
    content
        Elements and texts in order.
    attributes
        A trailing underscore is dropped and others become hyphens: ``class_``, ``aria_label``.
        An attribute that is None is left out.

    Returns
    -------
    xml.etree.ElementTree.Element
        The element; `render` escapes its texts.
    """
    stated = {
        k.rstrip("_").replace("_", "-"): str(v) for k, v in attributes.items() if v is not None
    }
    node = Element(tag, stated)
    for part in content:
        if not isinstance(part, str):
            node.append(part)
        elif len(node):
            node[-1].tail = (node[-1].tail or "") + part
        else:
            node.text = (node.text or "") + part
    return node


def table(
    heads: Sequence[str],
    rows: Sequence[Sequence[Content]],
    *,
    caption: str,
    class_: str | None = None,
) -> Element:
    """Make a table whose cells know the head of their column, for screens too narrow for columns.

    Parameters
    ----------
    heads
        Heads of the columns; the first column names the rows.
    rows
        Cells.
    caption
        What the table shows.
    class_
        For the style sheet.
    """
    body = []
    for cells in rows:
        named = zip(heads, cells, strict=True)
        first, *others = [(head, cell) for head, cell in named]
        row = [element("th", first[1], scope="row", data_label=first[0])]
        row += [element("td", cell, data_label=head) for head, cell in others]
        body.append(element("tr", *row))
    return element(
        "table",
        element("caption", caption),
        element("thead", element("tr", *(element("th", head, scope="col") for head in heads))),
        element("tbody", *body),
        class_=class_,
    )


def render(page: Element) -> str:
    """Write a page as HTML."""
    return "<!DOCTYPE html>\n" + tostring(page, encoding="unicode", method="html") + "\n"
