"""The camera driver against the real kernel: boots a virtual machine and runs `guest_*.py` in it."""

import platform
import sys

import pytest

from tests.kernel_vm import machine

GUESTS = {
    "tests/kernel_vm/guest_vivid.py": "fresh frame at 30 Hz",
    "tests/kernel_vm/guest_uvc.py": "USB camera, fresh frame at 30 Hz",
}
"""What runs in the machine, and a figure that it must have printed."""


@pytest.mark.parametrize("guest", GUESTS)
def test_the_driver_on_the_kernels_own_cameras(guest: str) -> None:
    if platform.machine() != "x86_64":
        pytest.skip(
            f"the virtual machine runs this Python, which must be of x86_64, not {platform.machine()}"
        )
    try:
        machine.prepare()
    except machine.CannotRunError as reason:
        pytest.skip(str(reason))
    options = ["-p", "no:cacheprovider", "-q", "-s", "--tb=short", "-o", "faulthandler_timeout=120"]
    status, said = machine.run([sys.executable, "-m", "pytest", *options, guest])
    print(said)
    assert status == 0, said
    assert GUESTS[guest] in said
