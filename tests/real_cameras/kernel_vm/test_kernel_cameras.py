"""Boot a virtual machine, and run `guest_*.py` in it, which test the camera driver with a real kernel."""

import platform
import sys

import pytest

from tests.real_cameras.kernel_vm import machine

BOOTS = {
    "vivid": {
        "guest_vivid.py": "fresh frame at 30 Hz",
        "guest_rig.py": "pull before the kernel's cameras",
        "guest_contract.py": "PASSED tests/real_cameras/kernel_vm/guest_contract.py",
    },
    "uvc": {"guest_uvc.py": "USB camera, fresh frame at 30 Hz"},
}
"""The programs that run in the virtual machine, and the text that each of them must print."""


@pytest.mark.long
@pytest.mark.timeout(2 * machine.DEADLINE_S)
@pytest.mark.parametrize("cameras", BOOTS)
def test_the_driver_on_the_kernels_own_cameras(cameras: str) -> None:
    if platform.machine() != "x86_64":
        pytest.skip(
            f"the virtual machine runs this Python, which must be of x86_64, not {platform.machine()}"
        )
    try:
        machine.prepare()
    except machine.CannotRunError as reason:
        pytest.skip(str(reason))
    guests = [f"tests/real_cameras/kernel_vm/{name}" for name in BOOTS[cameras]]
    options = ["-p", "no:cacheprovider", "-q", "-s", "-rA", "--tb=short", "-o", "faulthandler_timeout=120"]
    status, said = machine.run([sys.executable, "-m", "pytest", *options, *guests])
    print(said)
    assert status == 0, said
    assert [line for line in BOOTS[cameras].values() if line not in said] == []
