"""Tables in Markdown, and their place in a README."""

__all__ = ["number", "percent", "table", "tables_of", "three_digits", "with_tables"]

from collections.abc import Iterable, Sequence

BEGIN, END = "<!-- tables, written by the command -->\n", "\n<!-- /tables -->"
"""Between these a README has the tables of `results.json`, byte for byte."""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose first column names what the numbers of its row are of."""
    lines = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    lines.insert(1, "|---|" + "--:|" * (len(head) - 1))
    return "\n".join(lines)


def number(value: float | None, form: str = ".3g", spread: float | None = None) -> str:
    """A number, with its spread in brackets if it has one; nothing for None.

    A spread has no sign.
    """
    if value is None:
        return ""
    text = format(value, form)
    return text if spread is None else f"{text} ({format(spread, form.lstrip('+'))})"


def percent(part: float | None, form: str = ".3g") -> str:
    """A part of a whole as a percentage; nothing for None."""
    return "" if part is None else f"{100 * part:{form}} %"


def three_digits(value: float | None) -> str:
    """Three digits, or all that stand before the point; nothing for None."""
    return number(value, ".0f" if value is not None and abs(value) >= 100 else ".3g")


def tables_of(readme: str) -> str:
    """What stands between the marks of a README."""
    return _parts(readme)[1]


def with_tables(readme: str, tables: str) -> str:
    """A README with other tables between its marks."""
    before, _, after = _parts(readme)
    return before + BEGIN + tables + END + after


def _parts(readme: str) -> tuple[str, str, str]:
    """What stands before the marks, between them and behind.

    Raises:
        ValueError: The marks are not there.
    """
    before, begin, rest = readme.partition(BEGIN)
    tables, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"README.md must have the marks {BEGIN!r} and {END!r}")
    return before, tables, after
