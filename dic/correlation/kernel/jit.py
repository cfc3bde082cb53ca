"""Numba's compiler with typed decorators. Numba is imported only where machine code is not there yet.

A compiled function looks for its machine code in the user's files (`code_cache`), and loads it
(`machine_code`). If there is none, numba compiles the function, and the machine code is kept for later
processes.
"""

import logging
from collections.abc import Callable
from functools import cache, cached_property, update_wrapper
from importlib import import_module
from pathlib import Path
from threading import RLock
from typing import Any, TypeVar, cast

from dic.correlation.kernel import code_cache
from dic.correlation.kernel.machine_code import Kind, MachineCode, take_apart

Function = TypeVar("Function", bound=Callable[..., Any])

# Compile without numba's runtime (_nrt), which counts references to arrays. The kernel allocates no arrays.
_OPTIONS = {
    "error_model": "numpy",
    "_nrt": False,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}

_log = logging.getLogger("dic")
_lock = RLock()


def compiled(function: Function) -> Function:
    """Compile `function` to machine code at its first call, and keep the machine code on disk.

    The function returns nothing. Its machine code runs without Python's global lock. Division by zero gives
    infinity or NaN as in NumPy. The order of the terms in a sum stays as it is written.
    """
    code = function.__code__
    if code.co_freevars:
        raise TypeError(f"{function.__name__} is compiled and must not use variables of a function around it")
    name = f"{function.__name__}-{code.co_firstlineno}"
    return _in_place_of(function, _Compiled(lambda: function, Path(code.co_filename), name))


def compiled_in(module: str, name: str) -> Callable[..., None]:
    """Return a function in its compiled form, as `compiled` does; import its module only to compile it."""
    source = Path(__file__).parents[3].joinpath(*module.split(".")).with_suffix(".py")
    return _Compiled(lambda: getattr(import_module(module), name), source, name)


def inner(function: Function) -> Function:
    """Compile `function` for calls from compiled functions only, which saves time at compilation."""
    return _in_place_of(function, _Inner(lambda: function))


def inlined(function: Function) -> Function:
    """Compile `function` into each of its callers, so that calls of an innermost function take no time."""
    return _in_place_of(function, _Inner(lambda: function, forceinline=True))


def _in_place_of(function: Function, made: Any) -> Function:
    return cast(Function, update_wrapper(made, function))


class _Inner:
    """A function that numba compiles where a compiled function calls it."""

    def __init__(self, load: Callable[[], Callable[..., Any]], **options: bool) -> None:
        self._load, self._options = load, options

    @cached_property
    def _dispatcher(self) -> Any:
        import numba

        return numba.njit(**_OPTIONS, **self._options)(self._load())

    @property
    def _numba_type_(self) -> Any:
        """The type of this function for numba, which reads this name from each object in compiled code."""
        return self._dispatcher._numba_type_


class _Compiled(_Inner):
    """A function that is called from Python, with machine code for each kind of arguments."""

    def __init__(self, load: Callable[[], Callable[..., Any]], source: Path, name: str) -> None:
        super().__init__(load)
        self._source, self._name = source, name
        self._ready: dict[Kind, MachineCode] = {}

    def __call__(self, *arguments: Any) -> None:
        kind, parts = take_apart(arguments)
        code = self._ready.get(kind) or self._find(kind, arguments)
        code(parts)

    def _find(self, kind: Kind, arguments: tuple[Any, ...]) -> MachineCode:
        """Return the machine code for arguments of this kind: from its file, or newly compiled."""
        with _lock:
            if kind not in self._ready:
                file = code_cache.file_of(self._source, self._name, kind)
                images = file and code_cache.read(file)
                if not images:
                    _say(file and file.parent)
                    images = self._compile(kind, arguments)
                    if file is not None:
                        code_cache.write(file, images)
                self._ready[kind] = _loaded(images, kind)
            return self._ready[kind]

    def _compile(self, kind: Kind, arguments: tuple[Any, ...]) -> list[bytes]:
        """Return the object files for arguments of this kind, such as `arguments`."""
        import numba

        from dic.correlation.kernel.entry import entry_of

        types = tuple(numba.typeof(argument) for argument in arguments)
        self._dispatcher.compile(types)
        result = self._dispatcher.overloads[types]
        if result.signature.return_type != numba.types.none:
            raise TypeError(f"{self._name} is compiled and must return nothing")
        *_, (image, _) = result.library.serialize_using_object_code()
        return [image, entry_of(result.fndesc.llvm_func_name, kind)]


def _loaded(images: list[bytes], kind: Kind) -> MachineCode:
    try:
        return MachineCode(images, kind)
    except RuntimeError:
        # The machine code calls a library that numba loads, such as Intel's vector mathematics.
        import numba  # noqa: F401

        return MachineCode(images, kind)


@cache
def _say(folder: Path | None) -> None:
    """Tell the user of the first compilation in this process, which takes seconds."""
    later = "at every start, as there is no folder of this user alone for the machine code"
    if folder is not None:
        later = f"which takes some seconds; later calls find the machine code in {folder}"
    _log.info("compiling for this processor, %s", later)
