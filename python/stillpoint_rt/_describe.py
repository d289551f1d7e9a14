"""Loads the source of an operator, and describes its class for the checker."""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import inspect
import json
import linecache
import posixpath
import sys
import traceback
import types
from collections.abc import Mapping
from decimal import Decimal
from typing import Any

from .operator import Input, Operator, Output, Param
from .samples import sample_types

_TYPES = {bool: "switch", int: "integer", float: "number", str: "text"}


class Fault(Exception):
    """What is wrong with a source or a class, with its place."""


class _Sources(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds modules among the sources of an operator, before all others."""

    def __init__(self, sources: Mapping[str, bytes], folder: str) -> None:
        self.sources = sources
        self.folder = folder
        self.used: list[str] = []
        self.modules: list[str] = []

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        file = posixpath.join(self.folder, f"{name}.py")
        if "." in name or file not in self.sources:
            return None
        return importlib.machinery.ModuleSpec(name, self, origin=file)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> None:
        return None

    def exec_module(self, module: types.ModuleType) -> None:
        assert module.__spec__ is not None and module.__spec__.origin is not None
        self.modules.append(module.__name__)
        self.execute(module, module.__spec__.origin)

    def execute(self, module: types.ModuleType, file: str) -> None:
        self.used.append(file)
        module.__file__ = file
        text = self.sources[file].decode()
        # Messages and tracebacks show the lines of the source that was run, wherever the file is.
        linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
        exec(compile(text, file, "exec", dont_inherit=True), module.__dict__)


def load(name: str, sources: Mapping[str, bytes]) -> tuple[type[Operator], list[str]]:
    """Executes the source of a class in a module of its own. Gives the class, and the sources that were read.

    Raises Fault: the source cannot be run, or has no such class.
    """
    file, _, wanted = name.rpartition(":")
    finder = _Sources(sources, posixpath.dirname(file))
    module = types.ModuleType(posixpath.splitext(posixpath.basename(file))[0])
    sys.meta_path.insert(0, finder)
    try:
        finder.execute(module, file)
    except SyntaxError as error:
        raise Fault(f"{error.filename}:{error.lineno}: {type(error).__name__}: {error.msg}") from None
    except Exception as error:
        raise Fault(explain(error, sources)) from None
    finally:
        sys.meta_path.remove(finder)
        # The next load executes them anew: two operators share no global.
        for helper in finder.modules:
            sys.modules.pop(helper, None)
    found = module.__dict__.get(wanted)
    if not (isinstance(found, type) and issubclass(found, Operator)):
        classes = [key for key, value in module.__dict__.items() if _is_own(value)]
        there = f"it has {', '.join(classes)}" if classes else "it has none"
        raise Fault(f"{file}: there is no class {wanted} of stillpoint_rt.operator.Operator; {there}")
    return found, list(dict.fromkeys(finder.used))


def _is_own(value: Any) -> bool:
    return isinstance(value, type) and issubclass(value, Operator) and value is not Operator


def explain(error: BaseException, sources: Mapping[str, bytes]) -> str:
    """An exception with the last place of it that is in a source of the operator: `ops/op.py:7, in step: ValueError: ...`.

    The frames of the exception are cleared, so that it holds no array.
    """
    where = ""
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename in sources:
            where = f"{frame.filename}:{frame.lineno}, in {frame.name}: "
    # The text of a KeyError is its key in quotes.
    reason = error.args[0] if isinstance(error, KeyError) and error.args else error
    text = f"{where}{type(error).__name__}: {reason}"
    while error is not None:
        traceback.clear_frames(error.__traceback__)
        error = error.__cause__ or error.__context__
    return text


def describe(name: str, sources: Mapping[str, bytes]) -> str:
    """The description of a class as JSON, or `{"fault": ...}`."""
    try:
        found, used = load(name, sources)
        return json.dumps({**_described(name, found), "sources": used})
    except Fault as fault:
        return json.dumps({"fault": str(fault)})


def declarations(found: type[Operator]) -> dict[str, Input | Output | Param]:
    """Ports and parameters of a class by name, those of its bases first."""
    everything: dict[str, Any] = {}
    for base in reversed(found.__mro__):
        everything.update(vars(base))
    return {key: value for key, value in everything.items() if isinstance(value, (Input, Output, Param))}


def _described(name: str, found: type[Operator]) -> dict[str, Any]:
    declared = declarations(found)
    ports = {key: value for key, value in declared.items() if not isinstance(value, Param)}
    for port, value in ports.items():
        if value.sample not in sample_types():
            raise Fault(f"`{name}`: there is no sample {value.sample}, which `{port}` names")
    if found.step is Operator.step:
        raise Fault(f"`{name}` has no method `step`")
    if found.timer not in ("no", "optional", "required"):
        raise Fault(f"`{name}`: invalid timer: {found.timer} (allowed: no, optional, required)")
    about = inspect.getdoc(found) if "__doc__" in vars(found) else None
    return {
        "about": (about or f"The class {found.__name__}.").split("\n")[0],
        "timer": found.timer,
        "inputs": [
            {"name": key, "sample": v.sample, "queue": v.queue, "required": v.required, "about": v.about}
            for key, v in ports.items()
            if isinstance(v, Input)
        ],
        "outputs": [
            {
                "name": key, "sample": v.sample, "frame_of": v.frame_of, "framed": v.framed, "capacity": v.capacity,
                "about": v.about,
            }
            for key, v in ports.items()
            if isinstance(v, Output)
        ],
        "params": [_param(name, key, value) for key, value in declared.items() if isinstance(value, Param)],
    }  # fmt: skip


def _param(name: str, key: str, param: Param) -> dict[str, Any]:
    kind = param.type or type(param.default)
    if kind not in _TYPES:
        raise Fault(f"`{name}`: the parameter `{key}` has no default: give its type (float, int, bool, str)")

    def text(value: Any) -> str | None:
        if value is None:
            return None
        if kind is bool:
            return "true" if value else "false"
        if kind is str:
            return str(value)
        number = format(Decimal(repr(kind(value))), "f")
        return f"{number} {param.unit}" if param.unit else number

    return {
        "name": key,
        "type": _TYPES[kind],
        "unit": param.unit,
        "default": text(param.default),
        "min": text(param.min),
        "max": text(param.max),
        "choices": list(param.choices),
        "about": param.about or f"The parameter {key}.",
    }
