"""With any bad input, a command ends soon, with one sentence, status 2 and little memory."""

import re
from pathlib import Path

import pytest

from tests.fuzz.bad_inputs import BadInput, draw
from tests.fuzz.forks import MOST_S, Ended, forks
from tests.fuzz.good_files import make_good_files

MOST_BYTES = 2 * 2**30


def objections(bad: BadInput, ended: Ended) -> str:
    """Return the mistakes in a command's refusal of its input; an empty list without mistakes."""
    # click puts two lines about the usage before its own sentence
    said = [line for line in ended.err.splitlines() if line and not re.match(r"Usage: |Try |warning: ", line)]
    wrong = []
    if len(said) > 1 and re.search(r" (\d+) mistakes$", said[0]):
        # a file with several mistakes has a sentence for each, in a line of its own
        said = said[:1] if all(line.startswith("  ") for line in said[1:]) else said
    if ended.status != 2:
        wrong.append(f"status {ended.status}")
    if len(said) != 1 or "Traceback" in ended.err:
        wrong.append(f"{len(said)} lines: {ended.err[-1500:]!r}")
    elif not re.match(r"(error|rig|Error): .*\S", said[0]) or len(said[0]) > 3000:
        wrong.append(f"no sentence: {said[0][:300]!r}")
    if ended.cpu_s > MOST_S:
        wrong.append(f"{ended.cpu_s:.0f} s of CPU")
    if ended.memory_bytes > MOST_BYTES:
        wrong.append(f"{ended.memory_bytes / 2**30:.1f} GB")
    return f"{bad.what}: {'; '.join(wrong)} ({' '.join(bad.arguments)[:400]})" if wrong else ""


def campaign(folder: Path, count: int, seed: int) -> list[str]:
    """Run commands with bad inputs, and return the mistakes in their refusals."""
    (folder / "good").mkdir()
    good = make_good_files(folder / "good")
    before = {path: path.read_bytes() for path in good.files.values()}
    with forks(folder) as runner:
        found = [objections(bad, runner.run(bad.arguments)) for bad in draw(count, good.files, folder, seed)]
    assert {path: path.read_bytes() for path in good.files.values()} == before
    return [objection for objection in found if objection]


@pytest.mark.extended
def test_a_hundred_bad_inputs_end_with_a_sentence(tmp_path):
    assert campaign(tmp_path, 100, seed=1) == []


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_a_thousand_bad_inputs_end_with_a_sentence(tmp_path):
    assert campaign(tmp_path, 1000, seed=2) == []
