import subprocess
import sys

HEAVY = ("numpy", "scipy", "cv2", "numba", "h5py", "matplotlib", "rich")
PROGRAM = f"""
import sys
import dic.cli
sys.argv = ["dic", *sys.argv[1:]]
try:
    dic.cli.main()
except SystemExit:
    print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)
"""


def test_help_loads_nothing_heavy() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM, "--help"], capture_output=True, text=True)
    assert "correlate" in done.stdout
    assert done.stderr == "[]\n"
