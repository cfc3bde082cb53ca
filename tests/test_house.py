"""Rules of this project that no linter knows: places and sizes of modules, and patches in tests."""

import ast
import importlib
import inspect
import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import pytest

from tests.places import ROOT

PACKAGES = ("dic", "drivers", "rig", "simulators")
MODULES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
TESTS = sorted((ROOT / "tests").rglob("*.py"))
# In the root of these packages stands what everything else in them may import, and the command.
ROOTS = {
    "dic": {"__init__", "cli", "errors", "keywords", "settings", "typing"},
    "drivers": {"__init__", "interfaces", "signals", "registry", "settings", "errors", "clock"},
}
ARGUMENTS_MAX = 9
LINES_MAX = 400
CLOCKS = ("time.sleep", "time.time", "time.monotonic", "datetime.now", "datetime.utcnow")


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


def nodes(path: Path, containing: str = "") -> Iterator[ast.AST]:
    """Yield the nodes of a module whose text matches `containing`; the others are not parsed."""
    text = path.read_text()
    if re.search(containing, text):
        yield from ast.walk(ast.parse(text))


def functions(path: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in nodes(path):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Return the names of a function's arguments, without `self` and `cls`."""
    given = function.args
    every = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    return [each.arg for each in every if each is not None and each.arg not in ("self", "cls")]


@pytest.mark.parametrize("package", ROOTS)
def test_the_root_of_a_package_holds_only_what_all_of_it_shares(package: str) -> None:
    assert {path.stem for path in (ROOT / package).glob("*.py")} == ROOTS[package]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_folder_of_modules_says_what_is_in_it(package: str) -> None:
    folders = {path.parent for path in (ROOT / package).rglob("*.py")}
    silent = [
        named(folder)
        for folder in sorted(folders)
        if not (folder / "__init__.py").exists()
        or not ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))
    ]
    assert silent == []


def test_no_function_takes_more_arguments_than_a_person_can_keep_in_mind() -> None:
    many = {
        f"{named(path)}: {function.name}": len(arguments(function))
        for path in MODULES
        for function in functions(path)
        if len(arguments(function)) > ARGUMENTS_MAX
    }
    assert many == {}


def test_no_module_is_longer_than_can_be_surveyed() -> None:
    lengths = {named(path): len(path.read_text().splitlines()) for path in [*MODULES, *TESTS]}
    assert {name for name, lines in lengths.items() if lines > LINES_MAX} == set()


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = grimp.build_graph(*PACKAGES)
    assert len(graph.modules) > 200
    # it raises a CycleError that names the circle
    TopologicalSorter(
        {each: graph.find_modules_directly_imported_by(each) for each in graph.modules}
    ).prepare()


def test_only_the_clock_reads_the_time_and_sleeps() -> None:
    readers = {
        named(path)
        for path in MODULES
        for node in nodes(path, "|".join(map(re.escape, CLOCKS)))
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(CLOCKS)
    }
    assert readers == {"drivers/clock.py"}


@pytest.mark.parametrize("package", PACKAGES)
def test_everything_public_exists_and_is_described(package: str) -> None:
    module = importlib.import_module(package)
    public = [getattr(module, name) for name in module.__all__]
    public += [getattr(below, name) for below in filter(inspect.ismodule, public) for name in below.__all__]
    described = [value for value in public if inspect.isclass(value) or inspect.isroutine(value)]
    assert described
    for value in described:
        # a dataclass without a docstring is given its signature
        assert not (value.__doc__ or f"{value.__name__}(").startswith(f"{value.__name__}("), value


def test_commands_use_only_public_names_of_dic() -> None:
    used = []
    for path in (ROOT / "dic" / "commands").glob("*.py"):
        for node in nodes(path, "dic"):
            module = str(node.module) if isinstance(node, ast.ImportFrom) else ""
            if module.startswith("dic") and not module.startswith(("dic.commands", "dic.shell")):
                # In a module below `dic`, such as `dic.settings`, all names are for everyone.
                public = getattr(importlib.import_module(module), "__all__", None)
                names = {name.name for name in node.names}
                names -= names if public is None and module.count(".") == 1 else set(public or ())
                used += [f"{path.name}: {module}.{name}" for name in sorted(names)]
    assert used == []


def test_no_test_patches_a_time_that_could_be_a_parameter() -> None:
    patched = []
    for path in TESTS:
        for node in nodes(path, r"_S[\"']"):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith((".setattr", "patch.object")):
                names = [arg.value for arg in node.args if isinstance(arg, ast.Constant)]
                patched += [f"{named(path)}: {name}" for name in names if str(name).endswith("_S")]
    assert patched == []


def test_every_test_can_fail() -> None:
    """It asserts, expects an exception, or calls something that is named after checking."""
    claims = re.compile(r"\bassert\b|\braises\(|\bassert_\w+\(|\bcheck\w*\(|\bfollow\(")
    silent = [
        f"{named(path)}: {function.name}"
        for path in TESTS
        for function in functions(path)
        if function.name.startswith("test_") and not claims.search(ast.unparse(function))
    ]
    assert silent == []


def test_tests_are_laid_out_like_the_packages_that_they_test() -> None:
    folders = {path.parent.relative_to(ROOT / "tests") for path in TESTS if path.name.startswith("test_")}
    of_packages = [folder for folder in folders if folder.parts and folder.parts[0] in PACKAGES]
    assert len(of_packages) > 20
    assert [str(folder) for folder in of_packages if not (ROOT / folder).is_dir()] == []


def test_commands_print_in_one_way() -> None:
    """`dic.shell.console.say` prints above a bar, and survives an output that nobody reads."""
    own_way = {
        f"{named(path)}: line {node.lineno}"
        for path in MODULES
        if path.parent.name == "commands" or path.stem == "cli"
        for node in nodes(path)
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("print", "click.echo", "click.secho")
    }
    assert own_way == set()
