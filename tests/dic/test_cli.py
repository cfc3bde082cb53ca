import subprocess
import sys

import pytest

from tests.command_line import run_dic
from tests.image_files import write_image

HEAVY = ("scipy", "cv2", "numba", "h5py", "matplotlib", "rich")
PROGRAM = f"""
import sys
import dic.cli
sys.argv = ["dic", *sys.argv[1:]]
try:
    dic.cli.main()
except SystemExit:
    print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)
"""


def test_help_loads_nothing_heavier_than_numpy() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM, "--help"], capture_output=True, text=True)
    assert "correlate" in done.stdout
    assert done.stderr == "[]\n"


def test_a_plain_correlation_loads_neither_scipy_nor_numba_nor_h5py(speckle, tmp_path) -> None:
    """Numba only compiles, once for each version and processor."""
    pattern = speckle(seed=3, shape=(130, 130))
    write_image(tmp_path / "a.png", pattern.draw())
    write_image(tmp_path / "b.png", pattern.draw(lambda x, y: (x - 0.3, y)))
    command = [sys.executable, "-c", PROGRAM, "correlate", "a.png", "b.png"]
    for _ in range(2):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        if "compiling for this processor" not in done.stderr:
            break
    assert "b.png" in done.stdout
    assert done.stderr.splitlines()[-1] == "['cv2']"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["corelate"], "error: No such command 'corelate'. Did you mean 'correlate'? dic --help shows"),
        (["correlate", "--subst", "21", "a"], "--subset"),
        (["correlate"], "error: Missing argument 'REFERENCE'; dic correlate --help shows how it is used"),
    ],
)
def test_mistake_in_a_command_line_is_one_sentence(words, said):
    ended = run_dic(*words)
    assert ended.status == 2
    assert ended.err.count("\n") == 1
    assert said in ended.err
