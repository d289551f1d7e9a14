"""Samples as pandas frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .samples import Field, visible

if TYPE_CHECKING:
    import pandas as pd

    from .session import Topic


def pandas() -> Any:
    """pandas, imported when a frame is asked for.

    Raises ImportError: it is not installed.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise ImportError("frames need pandas: pip install 'stillpoint-rt[frames]'") from error
    return pd


def frame(topic: Topic, after: float | None, until: float | None, words: bool) -> pd.DataFrame:
    """See `Topic.frame`."""
    kind = topic.type
    rows = topic.array(after, until)
    index = pandas().Index(topic.time(rows), name="time")
    if kind.name == "Diagnostics":
        return _metrics(topic, rows, index, (after, until))
    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    for field in visible(kind.fields):
        _add(columns, units, field, rows[field.name], words, field.name)
    made = pandas().DataFrame(columns, index=index)
    if kind.is_slice:
        elements, starts = topic.elements(after, until)
        counts = np.diff(starts)
        made = made.iloc[_rows(counts)].copy()
        made["element"] = np.arange(len(elements)) - np.repeat(starts[:-1], counts)
        if kind.element_fields:
            for field in visible(kind.element_fields):
                # A journal has names that header, body and element share.
                name = f"element.{field.name}" if field.name in columns else field.name
                extra: dict[str, Any] = {}
                _add(extra, units, field, elements[field.name], words, name)
                for column, values in extra.items():
                    made[column] = values
        else:
            made["data"] = elements
    made.attrs["units"] = {column: unit for column, unit in units.items() if unit}
    made.attrs["frame"] = topic.frame_id
    return made


def _rows(counts: np.ndarray) -> np.ndarray:
    return np.repeat(np.arange(len(counts)), counts)


def _add(
    columns: dict[str, Any], units: dict[str, str], field: Field, values: np.ndarray, words: bool, name: str
) -> None:
    if field.is_text:
        columns[name] = [_text(row) for row in values]
        return
    for column, index, unit in field.columns():
        column = name + column[len(field.name) :]
        units[column] = unit
        found = values[(slice(None), *index)] if index else values
        if words and (field.codes or field.bits) and not field.shape:
            numbers, codes = np.unique(found, return_inverse=True)
            named = [field.words(number) for number in numbers]
            columns[column] = pandas().Categorical.from_codes(codes.reshape(-1), categories=named)
        else:
            columns[column] = found


def _text(row: np.ndarray) -> str:
    """Bytes as text where they are text filled with zeros, else in hexadecimal."""
    data = row.tobytes()
    text, _, rest = data.partition(b"\0")
    try:
        return text.decode() if not rest.strip(b"\0") else data.hex()
    except UnicodeDecodeError:
        return data.hex()


def _metrics(topic: Topic, rows: np.ndarray, index: Any, bounds: tuple[float | None, float | None]) -> pd.DataFrame:
    """Diagnostics: a column for each metric, NaN where a sample does not have it."""
    elements, starts = topic.elements(*bounds)
    of_row = _rows(np.diff(starts))
    raw = elements["name"]
    names = [_text(row) for row in raw]
    columns = {name: rows[name] for name in ("stamp", "origin", "sequence", "incarnation")}
    for name in dict.fromkeys(names):
        chosen = np.array([n == name for n in names])
        values = np.full(len(rows), np.nan)
        values[of_row[chosen]] = elements["value"][chosen]
        columns[name] = values
    made = pandas().DataFrame(columns, index=index)
    made.attrs["units"] = {"stamp": "ns", "origin": "ns"}
    return made
