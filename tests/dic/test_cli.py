import subprocess
import sys


def test_the_command_imports_nothing_heavy_before_it_must() -> None:
    heavy = ("numpy", "scipy", "cv2", "numba", "h5py", "matplotlib")
    program = f"import sys, dic.cli; print([name for name in {heavy} if name in sys.modules])"

    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout == "[]\n"
