"""A change of any file that affects the kernel's machine code changes the name of its cache folder."""

import ast
import shutil
from functools import cache
from pathlib import Path

import pytest

import dic
from dic.correlation.kernel.code_cache import COMPILED_IN, cache_key

PACKAGE = Path(dic.__file__).parent
KERNEL = PACKAGE / "correlation" / "kernel"


def file_of(module: str) -> Path | None:
    path = PACKAGE.parent.joinpath(*module.split("."))
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


@cache
def imported_by(path: Path) -> set[Path]:
    """Return the modules of `dic` that a file imports, directly or through other modules of `dic`."""
    found: set[Path] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            source = file_of(name) if name.split(".")[0] == "dic" else None
            if source is not None and source.name != "__init__.py" and source not in found:
                found |= {source} | imported_by(source)
    return found


def test_every_file_that_the_kernel_imports_is_in_the_key():
    imported = set().union(*(imported_by(path) for path in KERNEL.glob("*.py")))
    outside = {path.relative_to(PACKAGE).as_posix() for path in imported if path.parent != KERNEL}
    assert outside == set(COMPILED_IN)
    assert "correlation/status.py" in outside


@pytest.fixture
def copy(tmp_path):
    """A copy of the source files of `dic`."""
    return shutil.copytree(PACKAGE, tmp_path / "dic", ignore=shutil.ignore_patterns("__pycache__"))


def test_a_copy_has_the_same_key(copy):
    assert cache_key(copy) == cache_key(PACKAGE)


def test_every_file_of_the_kernel_and_every_file_compiled_in_changes_the_key(copy):
    names = [*COMPILED_IN, *(f"correlation/kernel/{path.name}" for path in KERNEL.glob("*.py"))]
    assert len(names) > len(COMPILED_IN)
    keys = {cache_key(copy)}
    for name in names:
        (copy / name).write_text((copy / name).read_text() + "\n")
        keys.add(cache_key(copy))
    assert len(keys) == 1 + len(names)


def test_other_status_values_have_another_key(copy):
    status, before = copy / "correlation" / "status.py", cache_key(copy)
    renumbered = status.read_text().replace("LOW_CORRELATION = 5", "LOW_CORRELATION = 9")
    assert renumbered != status.read_text()
    status.write_text(renumbered)
    assert cache_key(copy) != before


def test_a_file_that_the_kernel_does_not_import_leaves_the_key(copy):
    before = cache_key(copy)
    (copy / "correlation" / "field.py").write_text("")
    assert cache_key(copy) == before
