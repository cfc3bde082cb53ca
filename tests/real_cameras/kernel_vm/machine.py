"""A small virtual machine with Debian's own kernel and its virtual cameras, for tests of the camera driver.

    python -m tests.real_cameras.kernel_vm.machine COMMAND…

This program runs COMMAND in the virtual machine and returns its exit status. COMMAND can read this computer's
files, starts in this folder, and its written files are lost at the end. Kernel and modules are downloaded
once and kept in ~/.cache/offaxis/kernel-vm. The program needs no administrator rights. Booting takes some
seconds, even if the processor is emulated.
"""

import lzma
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

PACKAGES = {
    "qemu-system-x86_64": "qemu-system-x86",
    "busybox": "busybox-static",
    "cpio": "cpio",
    "modprobe": "kmod",
    "apt-get": "apt",
    "dpkg-deb": "dpkg",
}
MODULES = ("virtio_pci", "9p", "9pnet_virtio", "virtio_console", "overlay", "vivid", "vhci-hcd", "uvcvideo")
XZ = b"\xfd7zXZ\x00"
DEADLINE_S = 600
FAILED, LATE = 125, 124
BASE = f"base-{zlib.crc32(repr(MODULES).encode()):08x}.cpio"


class CannotRunError(Exception):
    """The virtual machine cannot run on this computer; the message gives the reason."""


def cache_folder() -> Path:
    """Return the folder in which kernel and modules are kept."""
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return caches / "offaxis" / "kernel-vm"


def missing_packages() -> list[str]:
    """Return the Debian packages that must be installed first."""
    search = os.environ.get("PATH", "") + ":/usr/sbin:/sbin"
    return [package for tool, package in PACKAGES.items() if shutil.which(tool, path=search) is None]


def prepare() -> Path:
    """Download kernel and modules if they are missing, and return their folder.

    Raises
    ------
    CannotRunError
        If tools are missing or Debian's packages cannot be reached.
    """
    missing = missing_packages()
    if missing:
        raise CannotRunError(f"install {' '.join(missing)} for a virtual machine with a kernel's cameras")
    folder = cache_folder()
    if (folder / BASE).exists():
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as built:
        try:
            _build(Path(built))
        except (subprocess.SubprocessError, OSError, ValueError, lzma.LZMAError) as error:
            raise CannotRunError(f"Debian's kernel cannot be fetched: {error}") from error
        # the second one last: it tells that both are there
        for name in ("vmlinux", BASE):
            (Path(built) / name).replace(folder / name)
    return folder


def run(command: list[str], *, timeout_s: float = DEADLINE_S) -> tuple[int, str]:
    """Run a command in the virtual machine.

    Returns
    -------
    status : int
        Exit status of the command; 125 if the virtual machine failed, 124 if it did not end in time.
    output : str
        The text that the command wrote to standard output and standard error.
    """
    folder = prepare()
    with tempfile.TemporaryDirectory() as scratch:
        own = Path(scratch)
        (own / "run.sh").write_text(_script(command))
        shutil.copy(Path(__file__).with_name("init"), own / "init")
        (own / "init").chmod(0o755)
        initrd = own / "initrd"
        packed = subprocess.run(
            ["cpio", "-o", "-H", "newc", "--quiet"],
            input=b"init\nrun.sh\n",
            cwd=own,
            capture_output=True,
            check=True,
        )
        initrd.write_bytes((folder / BASE).read_bytes() + packed.stdout)
        try:
            qemu = _qemu(folder, initrd, own / "output", own / "status")
            subprocess.run(qemu, timeout=timeout_s, check=False)
            ended = True
        except subprocess.TimeoutExpired:
            ended = False
        output, status = (
            (own / name).read_text("utf-8", "replace") if (own / name).exists() else ""
            for name in ("output", "status")
        )
    if not ended:
        return LATE, output
    return int(status) if status.strip() else FAILED, output


def _script(command: list[str]) -> str:
    here = Path.cwd()
    return "\n".join(
        [
            f"export PATH={shlex.quote(os.environ['PATH'])} HOME={shlex.quote(str(Path.home()))}",
            "export PYTHONDONTWRITEBYTECODE=1 OFFAXIS_KERNEL_VM=1",
            f"cd {shlex.quote(str(here))}",
            shlex.join(command),
            "",
        ]
    )


def _qemu(folder: Path, initrd: Path, output: Path, status: Path) -> list[str]:
    port = "virtserialport,bus=v.0,nr={0},chardev=c{0}"
    return [
        "qemu-system-x86_64",
        # emulated even where there is KVM: inside another virtual machine that may fail half-way
        *("-accel", "tcg", "-cpu", "Nehalem,check=off", "-M", "q35", "-smp", "1", "-m", "1024"),
        # its clock counts its own instructions: how busy this machine is hardly shows in it
        *("-icount", "shift=3"),
        *("-nodefaults", "-no-reboot", "-display", "none"),
        *("-kernel", str(folder / "vmlinux"), "-initrd", str(initrd)),
        *("-append", "quiet panic=-1 nokaslr mitigations=off random.trust_cpu=on no_timer_check"),
        *("-device", "virtio-serial-pci,id=v"),
        *("-chardev", f"file,id=c1,path={output}", "-device", port.format(1)),
        *("-chardev", f"file,id=c2,path={status}", "-device", port.format(2)),
        *("-fsdev", "local,id=h,path=/,security_model=none,multidevs=remap,readonly=on"),
        *("-device", "virtio-9p-pci,fsdev=h,mount_tag=host"),
    ]


def _build(folder: Path) -> None:
    """Write the kernel and the initial file system to a folder."""
    unpacked = folder / "unpacked"
    # linux-image-amd64 depends on the newest one; the kernel for clouds has no cameras
    words = _output(["apt-cache", "depends", "linux-image-amd64"]).split()
    named = [word for word in words if word.startswith("linux-image-") and word != "linux-image-amd64"]
    if not named:
        raise CannotRunError("Debian's kernel is not in the package lists (apt-get update)")
    subprocess.run(
        ["apt-get", "-qq", "download", named[0]], cwd=folder, check=True, timeout=120, capture_output=True
    )
    (archive,) = folder.glob("linux-image-*.deb")
    subprocess.run(["dpkg-deb", "-x", str(archive), str(unpacked)], check=True, timeout=120)
    (version,) = [path.name for path in (unpacked / "lib" / "modules").iterdir()]
    # started uncompressed: emulation would take seconds to unpack it
    packed = (unpacked / "boot" / f"vmlinuz-{version}").read_bytes()
    (folder / "vmlinux").write_bytes(lzma.LZMADecompressor().decompress(packed[packed.index(XZ) :]))
    _pack(unpacked, version, folder / "image", folder / BASE)


def _pack(unpacked: Path, version: str, image: Path, archive: Path) -> None:
    """Pack the kernel modules, in the order of loading, and the programs that load them."""
    (image / "modules").mkdir(parents=True)
    (image / "bin").mkdir()
    _sbin("depmod", "-b", str(unpacked), version)
    order: list[str] = []
    for module in MODULES:
        shown = _sbin("modprobe", "-d", str(unpacked), "-S", version, "--show-depends", module)
        for path in (Path(line.split()[1]) for line in shown.splitlines() if line.startswith("insmod")):
            name = path.name.removesuffix(".xz")
            if name not in order:
                order.append(name)
                content = path.read_bytes()
                (image / "modules" / name).write_bytes(
                    lzma.decompress(content) if path.suffix == ".xz" else content
                )
    (image / "order").write_text("\n".join(order) + "\n")
    shutil.copy(shutil.which("busybox") or "/bin/busybox", image / "bin" / "busybox")
    names = "\n".join(str(path.relative_to(image)) for path in sorted(image.rglob("*"))) + "\n"
    with archive.open("wb") as out:
        subprocess.run(
            ["cpio", "-o", "-H", "newc", "--quiet"], input=names.encode(), cwd=image, stdout=out, check=True
        )


def _sbin(tool: str, *arguments: str) -> str:
    return _output([shutil.which(tool, path="/usr/sbin:/sbin:/usr/bin:/bin") or tool, *arguments])


def _output(command: list[str]) -> str:
    return subprocess.run(command, check=True, timeout=120, capture_output=True, text=True).stdout


if __name__ == "__main__":
    try:
        status, said = run(sys.argv[1:])
        print(said, end="")
        sys.exit(status)
    except CannotRunError as reason:
        print(reason, file=sys.stderr)
        sys.exit(FAILED)
