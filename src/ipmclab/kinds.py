"""Arguments of a wrong kind, told by name: which one it is, what was given, what it takes, and how to get that.

What a public function takes stands once, in its annotations; ``tell_kinds`` holds every call against them. It reads
them as text: a word may be a class of a floor above, or one that is imported for type checkers alone.
"""

from __future__ import annotations

import ast
import functools
import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from numbers import Integral, Real
from os import PathLike, fspath
from typing import Any, Final, ParamSpec, TypeVar

import numpy as np

from ipmclab.errors import InputError

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class _Kind:
    """What a word of an annotation takes, and where one comes from: the words after "give"."""

    noun: str
    get: str
    takes: Callable[[Any], bool]
    reader: str = ""


def _is_whole(given: Any) -> bool:
    return isinstance(given, Integral) and not isinstance(given, bool)


def _is_number(given: Any) -> bool:
    if isinstance(given, (bool, np.bool_)):
        return False
    return isinstance(given, Real) or (hasattr(given, "__float__") and getattr(given, "ndim", 1) == 0)


def _are_numbers(given: Any) -> bool:
    if given is None or isinstance(given, (str, bytes, Mapping)):
        return False
    try:
        return np.asarray(given).dtype.kind in "biuf" or np.asarray(given, dtype=float).ndim > 0
    except (TypeError, ValueError):
        return False


def _is_engine(given: Any) -> bool:
    return hasattr(given, "map") and hasattr(given, "workers")


def _of(noun: str, get: str, *homes: str, reader: str = "") -> _Kind:
    """Objects of our own classes, found by their names: a floor above is not imported here."""
    names = {tuple(home.rsplit(".", 1)) for home in homes}
    return _Kind(
        noun, get, lambda given: any((one.__module__, one.__name__) in names for one in type(given).__mro__), reader
    )


_TEXT: Final = _Kind("a text", "a text in quotes", lambda given: isinstance(given, str))
_PATH: Final = _Kind(
    "a path", "the name of a file or folder, in quotes", lambda given: isinstance(given, (str, PathLike))
)
_FUNCTION: Final = _Kind("a function", "a function", callable)
_DICT: Final = _Kind("a dict", "a dict of names and values", lambda given: isinstance(given, Mapping))
_KINDS: Final = {
    **dict.fromkeys(("str", "Hold", "Device", "GoalName", "HoldOut"), _TEXT),
    **dict.fromkeys(("Path", "PathLike"), _PATH),
    **dict.fromkeys(("Callable", "OnProgress", "Progress", "Reduce"), _FUNCTION),
    **dict.fromkeys(("Mapping", "Covariance"), _DICT),
    "bool": _Kind("a truth value", "True or False", lambda given: isinstance(given, (bool, np.bool_))),
    "int": _Kind("a whole number", "a whole number", _is_whole),
    "float": _Kind("a number", "a number", _is_number),
    "ArrayLike": _Kind("an array of numbers", "a list or an array of numbers", _are_numbers),
    "Engine": _Kind("an engine", "one that engine.opened made", _is_engine),
    "Populations": _Kind("a tuple", "what populations_of returned", lambda given: isinstance(given, tuple)),
    "Run": _of("a run", "one that read_run read, or Run.from_arrays made", "ipmclab.run.run.Run", reader="read_run"),
    "Actuator": _of(
        "an actuator",
        "one that load_actuator read, or the actuator of a fit",
        "ipmclab.model.actuator.Actuator",
        reader="load_actuator",
    ),
    "Fit": _of(
        "a fit",
        "what identify returned, or read_fit(path) of what write_fit wrote",
        "ipmclab.fit.fit.Fit",
        reader="read_fit",
    ),
    "Signal": _of("a signal", "one such as signals.Step(amplitude=1.0)", "ipmclab.signals.signal.Signal"),
    "Environment": _of(
        "an environment",
        'one such as "20 degC, 80 %RH"',
        "ipmclab.model.environment.conditions.Environment",
        "ipmclab.model.environment.conditions.WaterState",
        "ipmclab.model.environment.history.EnvironmentHistory",
    ),
    "Finding": _of("a finding", "what check(run) returned", "ipmclab.run.finding.Finding"),
    "ImportMap": _of("an import map", "the map of what guess_map returned", "ipmclab.store.import_map.ImportMap"),
    "Sweep": _of("a sweep", "one that read_sweep read", "ipmclab.sweep.sweep.Sweep", reader="read_sweep"),
    "Procedure": _of(
        "a procedure", "one that read_procedure read", "ipmclab.procedure.procedure.Procedure", reader="read_procedure"
    ),
    "Posterior": _of("a posterior", "what sample_posterior returned", "ipmclab.posterior.posterior.Posterior"),
    "Samples": _of("a posterior", "what read_samples read of a posterior", "ipmclab.planning.draws.Samples"),
    "Allowance": _of("an allowance", "one such as Allowance(rest=60.0)", "ipmclab.planning.candidates.Allowance"),
    "Comparison": _of("a comparison", "what compare returned", "ipmclab.comparison.compare.Comparison"),
}
_UNIT: Final = re.compile(r"^ *(\w+(?:, \w+)*) : [^\n\[]*\[([^\]\n]+)\]", re.MULTILINE)
"""The unit of an argument, as a docstring has it."""
_ALIASES: Final = {"AnyEnvironment": "Environment | str"}
_ANYTHING: Final = ("Any", "Signals")


@dataclass(frozen=True)
class _Taken:
    """What one argument takes."""

    kinds: tuple[_Kind, ...]
    of_list: _Taken | None
    """What a list holds; None where no list is taken."""
    or_none: bool

    def fault(self, name: str, given: Any) -> InputError | None:
        """Why something is none of this."""
        if (given is None and self.or_none) or any(kind.takes(given) for kind in self.kinds):
            return None
        if self.of_list is not None and _is_list(given):
            faults = (self.of_list.fault(f"{name}[{place}]", one) for place, one in enumerate(given))
            return next((one for one in faults if one is not None), None)
        nouns = self._nouns()
        return InputError(
            f"{_shown(given)}, not {' or '.join([', '.join(nouns[:-1]), nouns[-1]] if nouns[1:] else nouns)}",
            code=f"not-{nouns[0].replace(' ', '-')}",
            where=name,
            repair=f"give {self._get(given)}",
        )

    def _nouns(self) -> list[str]:
        """What is taken; a list of what may also stand alone is not named."""
        nouns = list(dict.fromkeys(kind.noun for kind in self.kinds))
        if self.of_list is not None and not {kind.noun for kind in self.of_list.kinds} <= set(nouns):
            nouns.append(f"a list of {' or '.join(noun.partition(' ')[2] + 's' for noun in self.of_list._nouns())}")
        return nouns

    def _get(self, given: Any) -> str:
        reader = next((kind.reader for kind in self.kinds if kind.reader), "")
        if reader and isinstance(given, (str, PathLike)):
            return f"{reader}({fspath(given)!r})"
        if self.of_list is not None and self.of_list.fault("", given) is None:
            return f"a list: [{fspath(given)!r}]" if isinstance(given, (str, PathLike)) else "a list: [...]"
        if self.of_list is not None and not self.kinds:
            return f"a list; for each {self.of_list._get(given)}"
        return ", or ".join(dict.fromkeys(kind.get for kind in self.kinds))


def _shown(given: Any) -> str:
    kind = "NumPy array" if isinstance(given, np.ndarray) else type(given).__name__
    article = "an" if kind[0] in "aeiouAEIOU" else "a"
    if given is None:
        return "this is None"
    return (
        f"{fspath(given)!r} is {article} {kind}" if isinstance(given, (str, PathLike)) else f"this is {article} {kind}"
    )


def _is_list(given: Any) -> bool:
    is_one = isinstance(given, (str, bytes, PathLike, Mapping, type))
    return isinstance(given, Iterable) and not is_one and getattr(given, "ndim", 1) == 1


def _read(node: ast.AST, unit: str) -> _Taken:
    """What an annotation says, such as ``Sequence[Run] | Run``."""
    match node:
        case ast.Expression(body=body):
            return _read(body, unit)
        case ast.BinOp(left=left, right=right):
            one, other = _read(left, unit), _read(right, unit)
            kinds = one.kinds + other.kinds
            kinds = tuple([kind for kind in kinds if kind is not _TEXT or _PATH not in kinds])
            return _Taken(kinds, one.of_list or other.of_list, one.or_none or other.or_none)
        case ast.Constant(value=None):
            return _Taken((), None, or_none=True)
        case ast.Subscript(value=ast.Name(id="Sequence" | "Iterable"), slice=inner):
            return _Taken((), _read(inner, unit), or_none=False)
        case ast.Subscript(value=value):
            return _read(value, unit)
        case ast.Attribute(attr=word) | ast.Name(id=word):
            if word in _ALIASES:
                return _read(ast.parse(_ALIASES[word], mode="eval"), unit)
            kind = _KINDS[word]
            return _Taken(
                (replace(kind, get=f"{kind.get} in {unit}") if unit and word in ("float", "ArrayLike") else kind,),
                None,
                or_none=False,
            )
    raise KeyError(ast.unparse(node))


def tell_kinds(function: Callable[P, R]) -> Callable[P, R]:
    """Hold each call of a function against its annotations, before anything is done.

    An iterator that is given in the place of a list is listed.

    Parameters
    ----------
    function : callable
        Annotated by words of the table above; another word is a ``KeyError`` at its first call. A unit is that of
        its docstring: ``duration : float [s]``.

    Raises
    ------
    InputError
        By the function: an argument of a wrong kind.

    Examples
    --------
    >>> @tell_kinds
    ... def wait(duration: float, times: int = 1) -> None:
    ...     '''duration : float [s]'''
    >>> wait(1.5, times=2)
    >>> wait("1.5")
    Traceback (most recent call last):
        ...
    ipmclab.errors.InputError: duration: '1.5' is a str, not a number; give a number in s
    """
    names = [one.name for one in inspect.signature(function).parameters.values() if one.kind is not one.KEYWORD_ONLY]
    units = _UNIT.findall(function.__doc__ or "")

    @functools.cache
    def declared() -> dict[str, _Taken]:
        words = inspect.unwrap(function).__annotations__
        return {
            name: _read(
                ast.parse(words[name], mode="eval"),
                next((unit for args, unit in units if name in args.split(", ")), ""),
            )
            for name in words.keys() - {"return"}
            if words[name] not in _ANYTHING
        }

    fine: set[tuple[str, type]] = set()  # where the type alone decides: all but lists and arrays

    def held(name: str, given: Any) -> Any:
        taken = None if (name, type(given)) in fine else declared().get(name)
        if taken is None:
            return given
        if taken.of_list is not None and isinstance(given, Iterator):
            given = list(given)
        if fault := taken.fault(name, given):
            raise fault
        if isinstance(given, (str, Mapping)) or not isinstance(given, Iterable):
            fine.add((name, type(given)))
        return given

    @functools.wraps(function)
    def told(*args: P.args, **kwargs: P.kwargs) -> R:
        known = fine.issuperset
        if known(zip(names, map(type, args))) and (  # noqa: B905 - "strict" takes as long as the rest
            not kwargs or known(zip(kwargs, map(type, kwargs.values())))  # noqa: B905
        ):
            return function(*args, **kwargs)
        places = [held(name, given) for name, given in zip(names, args, strict=False)]
        named = {name: held(name, given) for name, given in kwargs.items()}
        return function(*places, *args[len(places) :], **named)  # type: ignore[arg-type]

    return told
