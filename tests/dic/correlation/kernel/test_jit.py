"""Compiled functions compute what Python computes, and are compiled once for all folders of a package."""

import logging
import os
import shutil
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import dic
from dic.correlation.kernel import code_cache, jit
from dic.correlation.kernel.entry import entry_of
from dic.correlation.kernel.machine_code import MachineCode

SOURCE = """
from dic.correlation.kernel.jit import compiled

@compiled
def double(values):
    for k in range(len(values)):
        values[k] *= 2.0
"""


class Group(NamedTuple):
    by_row: np.ndarray
    by_column: np.ndarray
    number: int
    inner: tuple[float, bool, np.ndarray]


@jit.compiled
def sums(group, kept, empty, scale, out):
    weight, minus, whole = group.inner
    total = 0.0
    for i in range(group.by_row.shape[0]):
        for j in range(group.by_row.shape[1]):
            total += group.by_row[i, j] * group.by_column[i, j] * kept[i, j]
    out[0, 0] = -total if minus else total
    out[1, 0] = weight * scale + len(empty) + group.number
    out[2, 0] = whole[0] / whole[1]


def test_arrays_of_every_order_and_numbers_of_every_kind_arrive_as_they_are():
    """This is the guard of numba's calling convention and of NumPy's structure for arrays."""
    random = np.random.default_rng(5)
    by_row, by_column, kept, out = random.normal(size=(4, 6, 8))
    by_column, kept, out = np.asfortranarray(by_column)[:3, :4], kept[::2, ::-2], out[::2, 1::3]
    kept.flags.writeable = False
    group = Group(by_row[:3, :4].astype(np.float32), by_column, 2**40, (0.25, True, np.array([1, 8])))
    sums(group, kept, np.empty((0, 3)), np.float64(3.0), out)
    expected = [-(group.by_row * by_column * kept).sum(), 0.25 * 3.0 + 2**40, 0.125]
    np.testing.assert_allclose(out[:, 0], expected, rtol=1e-12)
    assert len(sums._ready) == 1
    sums(group._replace(inner=(0.25, np.False_, np.array([1, 0]))), kept, np.empty((1, 3)), 3.0, out)
    expected = [(group.by_row * by_column * kept).sum(), 0.25 * 3.0 + 2**40 + 1, np.inf]
    np.testing.assert_allclose(out[:, 0], expected, rtol=1e-12)
    assert len(sums._ready) == 1
    with pytest.raises(TypeError, match="arrays, tuples and numbers, not list"):
        sums([1.0], kept, np.empty((0, 3)), 3.0, out)


def test_a_compiled_function_neither_returns_a_value_nor_captures_variables():
    with pytest.raises(TypeError, match="must return nothing"):
        jit.compiled(lambda a: a + 1.0)(2.0)
    number = 2.0
    with pytest.raises(TypeError, match="must not use variables of a function around it"):
        jit.compiled(lambda a: a.fill(number))


@pytest.fixture
def compilations(tmp_path, monkeypatch):
    """A folder for machine code, and the list of functions that were compiled."""
    names, compile_now = [], jit._Compiled._compile

    def counted(self, *arguments):
        names.append(self._name)
        return compile_now(self, *arguments)

    monkeypatch.setattr(jit._Compiled, "_compile", counted)
    monkeypatch.setattr(code_cache, "cache_folder", lambda: tmp_path / "kept" / ("0" * 16))
    (tmp_path / "kept").mkdir()
    return names


def doubled(file: Path, source: str = SOURCE) -> float:
    """Write the module `file`, import it as in a new process, and return 1.5 doubled by it."""
    file.parent.mkdir(exist_ok=True)
    file.write_text(source)
    spec = spec_from_file_location("module", file)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    values = np.full(2, 1.5)
    module.double(values)
    return values[1]


def test_only_another_source_is_compiled_again(compilations, tmp_path):
    assert doubled(tmp_path / "one" / "module.py") == 3.0
    assert doubled(tmp_path / "two" / "other_name.py") == 3.0
    assert len(compilations) == 1
    assert doubled(tmp_path / "two" / "module.py", SOURCE.replace("2.0", "4.0")) == 6.0
    assert len(compilations) == 2


@pytest.mark.parametrize(
    "damage", [lambda old: old[:-9], lambda old: old[:99] + bytes([old[99] ^ 1]) + old[100:], lambda old: b""]
)
def test_damaged_machine_code_is_compiled_again(compilations, tmp_path, damage):
    doubled(tmp_path / "module.py")
    (kept,) = (tmp_path / "kept" / ("0" * 16)).iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(damage(whole))
    assert doubled(tmp_path / "module.py") == 3.0
    assert len(compilations) == 2
    assert doubled(tmp_path / "module.py") == 3.0
    assert len(compilations) == 2


def test_without_a_folder_the_machine_code_is_only_in_memory(compilations, tmp_path, monkeypatch, caplog):
    """The user is told so once."""
    monkeypatch.setattr(code_cache, "cache_folder", lambda: None)
    jit._say.cache_clear()
    with caplog.at_level(logging.INFO, "dic"):
        assert doubled(tmp_path / "module.py") == doubled(tmp_path / "module.py") == 3.0
    assert len(compilations) == 2
    assert [message.split(", ")[1] for message in caplog.messages] == ["at every start"]


def test_machine_code_that_needs_an_unknown_function_is_an_error():
    with pytest.raises(RuntimeError):
        MachineCode([entry_of("no_such_function", (int,))], (int,))


PROGRAM = """
import sys
import numpy as np
from dic.strain.measure_kernel import set_derivative
found = np.zeros((4, 6))
set_derivative(0, np.full((2, 2), 0.5), found)
print("numba" in sys.modules, found[0, 0])
"""


@pytest.mark.extended
def test_a_copy_of_the_package_elsewhere_compiles_nothing(tmp_path):
    """Numba itself is imported only where something is compiled."""
    package = Path(dic.__file__).parent
    shutil.copytree(package, tmp_path / "copy" / "dic", ignore=shutil.ignore_patterns("__pycache__"))
    said = []
    for folder in (package.parent, tmp_path / "copy", package.parent):
        environment = os.environ | {"PYTHONPATH": str(folder), "XDG_CACHE_HOME": str(tmp_path / "caches")}
        command = [sys.executable, "-c", PROGRAM]
        said.append(
            subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
        )
    assert said == ["True 1.5\n", "False 1.5\n", "False 1.5\n"]
