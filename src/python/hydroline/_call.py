"""From keyword arguments to a command line, and the call of it."""

from __future__ import annotations

import datetime
import difflib
import os
import re
import tempfile
import warnings
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

from . import _hydroline
from ._errors import ArgumentError, Error, LossyWarning

PathLike = Union[str, "os.PathLike[str]"]
Paths = Union[PathLike, Sequence[PathLike]]
RigLike = Union[PathLike, _hydroline.Rig]
PlanLike = Union[PathLike, _hydroline.Plan]
#: Called with the stage, how many are done, and of how many where that is known; or a tqdm bar or its class.
Progress = Union[Callable[[str, int, Optional[int]], object], Any, None]

_definitions: Dict[str, Tuple[str, List[Dict[str, Any]]]] = {}


def definition(command: str) -> Tuple[str, List[Dict[str, Any]]]:
    """First line and arguments of a command, as the command line defines them."""
    if command not in _definitions:
        _definitions[command] = _hydroline.definition(command)
    return _definitions[command]


def keyword_of(name: str) -> str:
    """The keyword of a flag: ``--write-rig`` is ``write_rig``; ``--from`` is ``from_``, as Python has a word ``from``."""
    import keyword

    word = name.replace("-", "_")
    return word + "_" if keyword.iskeyword(word) else word


def _text(function: str, name: str, value: object, files: "_Files") -> str:
    """A value as the command line takes it."""
    if isinstance(value, (_hydroline.Rig, _hydroline.Plan)):
        return value.source if value.source is not None else files.write(value)
    if isinstance(value, bool):
        raise _wrong(function, name, value)
    if isinstance(value, str):
        return value
    if isinstance(value, os.PathLike):
        path = os.fspath(value)
        if isinstance(path, str):
            return path
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    if isinstance(value, datetime.datetime):
        return value.astimezone(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    if hasattr(value, "__index__"):
        return str(int(value))
    if hasattr(value, "__float__"):
        return repr(float(value))
    raise _wrong(function, name, value)


def _keywords(command: str, error: Error) -> None:
    """Names arguments in an exception's words as the function has them: the command line writes ``--hold-out <LOG>``."""
    arguments = {a["name"] for a in definition(command)[1]}

    def keyword(found: "re.Match[str]") -> str:
        name = found.group(1)
        return keyword_of(name) if name in arguments else found.group(0)

    words = re.sub(r"(?<![\w-])--([a-z][a-z0-9]*(?:-[a-z0-9]+)*)(?: <[^<>]*>)?(?:\.\.\.)?", keyword, str(error))
    error.args = (words, *error.args[1:])


def _is_default(argument: Mapping[str, Any], value: object) -> bool:
    """Whether a value is what stands where none is given: some flags may only be given together with others."""
    default = argument["default"]
    if default is None or isinstance(value, bool):
        return False
    if argument["kind"] in ("integer", "number") and isinstance(value, (int, float)):
        return float(default) == value
    return bool(default == value)


def _describe(argument: Mapping[str, Any]) -> str:
    kinds = {
        "flag": "True or False",
        "integer": "a whole number",
        "number": "a number",
        "path": "a path",
        "word": "one of " + ", ".join(argument["allowed"]),
        "text": f"a text ({argument['value_name']})",
    }
    several = ", or a sequence of such" if argument["several"] else ""
    return kinds[argument["kind"]] + several


def _wrong(function: str, name: str, value: object) -> ArgumentError:
    command = "import" if function == "import_table" else function
    argument = next(a for a in definition(command)[1] if keyword_of(a["name"]) == name)
    return ArgumentError(
        f"{function}({name}={value!r}): a {type(value).__name__}; allowed: {_describe(argument)}",
        name,
        repr(value),
        argument["allowed"],
    )


class _Files:
    """Files that are made of objects for the time of a call."""

    def __init__(self) -> None:
        self._folder: Optional[tempfile.TemporaryDirectory[str]] = None
        self._count = 0

    def write(self, item: Union[_hydroline.Rig, _hydroline.Plan]) -> str:
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="hydroline-")
        self._count += 1
        path = Path(self._folder.name) / f"{self._count}.toml"
        path.write_text(item.to_toml(), encoding="utf-8")
        return str(path)

    def close(self) -> None:
        if self._folder is not None:
            self._folder.cleanup()


def words(function: str, command: str, given: Mapping[str, object], files: _Files) -> List[str]:
    """The command line of a call; ``None`` is not given."""
    arguments = {keyword_of(a["name"]): a for a in definition(command)[1]}
    flags: List[str] = []
    places: List[str] = []
    for name, value in given.items():
        argument = arguments.get(name)
        if argument is None:
            near = difflib.get_close_matches(name, arguments, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise ArgumentError(
                f"{function}({name}=...): no such argument{hint} Allowed: {', '.join(arguments)}",
                name,
                repr(value),
                list(arguments),
            )
        if value is None or _is_default(argument, value):
            continue
        if argument["kind"] == "flag":
            if not isinstance(value, bool):
                raise _wrong(function, name, value)
            if value:
                flags.append("--" + argument["name"])
            continue
        several = argument["several"] and isinstance(value, Iterable)
        single = isinstance(value, (str, os.PathLike)) or not several
        values = [value] if single else list(value)  # type: ignore[call-overload]
        texts = [_text(function, name, v, files) for v in values]
        if argument["positional"]:
            places.extend(texts)
        else:
            flags.extend(f"--{argument['name']}={text}" for text in texts)
    return [command, *flags, "--json", "--", *places]


def _bar(progress: Any) -> Callable[[str, int, Optional[int]], object]:
    """A tqdm bar as a function."""
    bar = progress() if isinstance(progress, type) else progress

    def tell(stage: str, done: int, of: Optional[int]) -> None:
        if of is not None:
            bar.total = of
        bar.set_description_str(stage, refresh=False)
        bar.update(done - bar.n)

    return tell


def call(
    function: str, command: str, given: Mapping[str, object], progress: Progress
) -> "_hydroline.Called":
    """Runs a command with these arguments; the GIL is released meanwhile, and Ctrl-C ends it."""
    if progress is not None and hasattr(progress, "set_description_str"):
        progress = _bar(progress)
    if progress is not None and not callable(progress):
        raise ArgumentError(
            f"{function}(progress={progress!r}): a {type(progress).__name__}; allowed: a function of "
            "(stage, done, of), a tqdm bar or its class, None",
            "progress",
            repr(progress),
        )
    files = _Files()
    try:
        called = _hydroline.call(words(function, command, given, files), progress)
    except Error as error:
        _keywords(command, error)
        raise
    finally:
        files.close()
    if called.lossy:
        lost = "; ".join(called.remarks) or "the result says what"
        warnings.warn(f"{function}: done, but something was lost: {lost}", LossyWarning, stacklevel=4)
    return called
