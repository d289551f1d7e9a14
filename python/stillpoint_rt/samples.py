"""Sample types: their fields, and their bytes as structured arrays."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from . import _native

_NUMBERS = {
    "uint8": "u1", "int8": "i1", "uint16": "<u2", "int16": "<i2", "uint32": "<u4", "int32": "<i4",
    "uint64": "<u8", "int64": "<i8", "float32": "<f4", "float64": "<f8",
}  # fmt: skip
_HIDDEN = ("reserved", "length")


@dataclass(frozen=True)
class Field:
    """A field of a sample: a number, or an array of numbers."""

    name: str
    """Name in the array."""
    dtype: np.dtype
    """Type of each number."""
    shape: tuple[int, ...]
    """Shape of the array; empty for one number."""
    unit: str
    """SI unit; empty for plain numbers. An array of several units names all of them."""
    about: str
    """What it holds, in a sentence."""
    codes: dict[int, str]
    """Words of the numbers, where the field is one of several codes."""
    bits: dict[int, str]
    """Words of the bits, where the field is a set of bits."""
    parts: tuple[str, ...]
    """Words of the values of an array, such as x, y, z."""

    @property
    def is_text(self) -> bool:
        """Whether the bytes are a text filled with zeros."""
        return bool(self.shape) and self.dtype == np.uint8

    def words(self, number: int) -> str | None:
        """The words of a number of this field: of its code, or of its bits. None where its numbers have no words."""
        number = int(number)
        if self.codes:
            return self.codes.get(number, f"{number} (unknown to this build)")
        if self.bits:
            known = [word for bit, word in self.bits.items() if bit and number & bit == bit]
            rest = number & ~sum(self.bits)
            unknown = [f"bit {bit} (unknown to this build)" for bit in range(64) if rest >> bit & 1]
            return ", ".join(known + unknown) or "none"
        return None

    def columns(self) -> list[tuple[str, tuple[int, ...], str]]:
        """The columns of a frame: name, index in the array, unit."""
        if not self.shape or self.is_text:
            return [(self.name, (), self.unit)]
        columns = []
        units = self.unit.split(", ")
        for number, index in enumerate(np.ndindex(self.shape)):
            if number < len(self.parts):
                name = f"{self.name}.{self.parts[number]}"
            else:
                name = self.name + "".join(f"[{i}]" for i in index)
            # The six channels of a pose have two units: of the coordinates, and of the angles.
            pose = len(units) == 2 and len(self.parts) == 6
            columns.append((name, index, units[0 if number < 3 else 1] if pose else self.unit))
        return columns

    @classmethod
    def _of(cls, described: dict[str, Any]) -> Field:
        names, listed = described["names"], described["list"]
        words = {code["value"]: code["word"] for code in listed} if names in ("codes", "bits") else {}
        if names == "each":
            words = {1 << bit: f"{listed} {bit}" for bit in range(64)}
        shape: tuple[int, ...] = (described["array"],) if described["array"] else ()
        return cls(
            name=described["name"],
            dtype=np.dtype(_NUMBERS[described["type"]]),
            shape=tuple(listed) if names == "rows" else shape,
            unit=described["unit"],
            about=described["about"],
            codes=words if names == "codes" else {},
            bits=words if names in ("bits", "each") else {},
            parts=tuple(code["word"] for code in listed) if names == "parts" else (),
        )


@dataclass(frozen=True)
class SampleType:
    """A type of samples.

    A *fixed* sample has one element: `dtype` has the fields of header and element. A *slice* has a header, a body that is
    stated once, and any number of elements: `dtype` has the fields of header and body, `element` those of an element.
    """

    name: str
    type_name: str
    """Name with the hash of the layout."""
    about: str
    is_slice: bool
    head: tuple[Field, ...]
    """Fields of header and body."""
    element_fields: tuple[Field, ...]
    """Fields of an element; empty where an element is a bare number."""
    meta_dtype: np.dtype
    """Header and body."""
    element: np.dtype
    """One element."""

    @property
    def dtype(self) -> np.dtype:
        """One row of an array of samples."""
        if self.is_slice:
            return self.meta_dtype
        return np.dtype(self.meta_dtype.descr + self.element.descr)

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields of `dtype`."""
        return self.head if self.is_slice else self.head + self.element_fields

    def field(self, name: str) -> Field:
        """The field of this name.

        Raises KeyError: there is no such field.
        """
        for field in self.head + self.element_fields:
            if field.name == name:
                return field
        raise KeyError(f"{self.name} has no field {name!r}")

    @classmethod
    def _of(cls, described: dict[str, Any]) -> SampleType:
        head = tuple(Field._of(field) for field in described["header"] + described["body"])
        element = tuple(Field._of(field) for field in described["element"])
        bare = described["number"]
        made = cls(
            name=described["name"],
            type_name=described["type"],
            about=described["about"],
            is_slice=described["is_slice"],
            head=head,
            element_fields=element,
            meta_dtype=_dtype(head),
            element=np.dtype(_NUMBERS[bare]) if bare else _dtype(element),
        )
        # The bytes of a sample have no padding, so both sides count the same.
        assert made.meta_dtype.itemsize == described["meta_size"], described["name"]
        assert made.element.itemsize == described["element_size"], described["name"]
        return made


def _dtype(fields: tuple[Field, ...]) -> np.dtype:
    return np.dtype([(field.name, field.dtype, field.shape) for field in fields])


@cache
def sample_types() -> dict[str, SampleType]:
    """Every type of samples of this build, by name."""
    return {name: SampleType._of(described) for name, described in json.loads(_native.sample_kinds()).items()}


def visible(fields: tuple[Field, ...]) -> list[Field]:
    """The fields that hold something for readers."""
    return [field for field in fields if field.name not in _HIDDEN]


class Sample:
    """A sample of an input, or one that is to be sent. Arrays of inputs are read-only."""

    __slots__ = ("_meta", "elements", "type")

    def __init__(self, kind: SampleType, meta: np.ndarray, payload: np.ndarray) -> None:
        self.type = kind
        self._meta = meta.view(kind.meta_dtype)
        self.elements: np.ndarray = payload.view(kind.element)[: int(self._meta["count"][0])]
        """The elements, one row each: a structured array, or numbers."""

    def __len__(self) -> int:
        return len(self.elements)

    def __getitem__(self, name: str) -> Any:
        """A field by name: of header or body; of the element of a fixed sample; of all elements of a slice (n values)."""
        if name in (self._meta.dtype.names or ()):
            return self._meta[name][0]
        if name in (self.elements.dtype.names or ()):
            return self.elements[name] if self.type.is_slice else self.elements[name][0]
        raise KeyError(f"{self.type.name} has no field {name!r}")
