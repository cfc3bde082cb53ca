"""The memory layout of the kernel's camera interface is that which a C compiler gives the kernel's header."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest

from drivers.cameras.v4l2 import abi

STRUCTURES = {
    "v4l2_capability": abi.CapabilityInfo,
    "v4l2_format": abi.Format,
    "v4l2_pix_format": abi.PixelFormat,
    "v4l2_streamparm": abi.CaptureParameters,
    "v4l2_requestbuffers": abi.BufferRequest,
    "v4l2_buffer": abi.Buffer,
    "v4l2_queryctrl": abi.ControlQuery,
    "v4l2_control": abi.ControlValue,
}
MEMBERS = {
    ("v4l2_format", "fmt.pix"): abi.Format.fmt,
    ("v4l2_pix_format", "bytesperline"): abi.PixelFormat.bytesperline,
    ("v4l2_pix_format", "sizeimage"): abi.PixelFormat.sizeimage,
    ("v4l2_pix_format", "field"): abi.PixelFormat.field,
    ("v4l2_capability", "device_caps"): abi.CapabilityInfo.device_caps,
    ("v4l2_streamparm", "parm.capture.timeperframe.numerator"): abi.CaptureParameters.numerator,
    ("v4l2_streamparm", "parm.capture.timeperframe.denominator"): abi.CaptureParameters.denominator,
    ("v4l2_buffer", "bytesused"): abi.Buffer.bytesused,
    ("v4l2_buffer", "flags"): abi.Buffer.flags,
    ("v4l2_buffer", "timestamp.tv_sec"): abi.Buffer.seconds,
    ("v4l2_buffer", "timestamp.tv_usec"): abi.Buffer.microseconds,
    ("v4l2_buffer", "sequence"): abi.Buffer.sequence,
    ("v4l2_buffer", "memory"): abi.Buffer.memory,
    ("v4l2_buffer", "m.offset"): abi.Buffer.offset,
    ("v4l2_buffer", "length"): abi.Buffer.length,
    ("v4l2_queryctrl", "minimum"): abi.ControlQuery.minimum,
    ("v4l2_queryctrl", "step"): abi.ControlQuery.step,
    ("v4l2_queryctrl", "flags"): abi.ControlQuery.flags,
}
CONSTANTS = {
    **{f"VIDIOC_{request.name}": request.value for request in abi.RequestCode},
    **{f"V4L2_CID_{id.name}": id.value for id in abi.ControlId},
    **{f"V4L2_CTRL_FLAG_{flag.name}": flag.value for flag in abi.ControlFlag},
    **{f"V4L2_CTRL_TYPE_{kind.name}": kind.value for kind in abi.ControlType},
    **{f"V4L2_CAP_{flag.name}": flag.value for flag in abi.Capability},
    **{f"V4L2_PIX_FMT_{code}": abi.fourcc(code) for code in ("GREY", "Y10", "Y12", "Y16", "YUYV")},
    "V4L2_BUF_FLAG_ERROR": abi.BufferFlag.ERROR,
    "V4L2_BUF_FLAG_TIMESTAMP_MASK": abi.BufferFlag.CLOCK,
    "V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC": abi.BufferFlag.MONOTONIC,
    "V4L2_BUF_FLAG_TSTAMP_SRC_MASK": abi.BufferFlag.STAMP_PLACE,
    "V4L2_BUF_FLAG_TSTAMP_SRC_SOE": abi.BufferFlag.STAMP_AT_START,
    "V4L2_BUF_TYPE_VIDEO_CAPTURE": abi.CAPTURE,
    "V4L2_MEMORY_MMAP": abi.MMAP,
    "V4L2_PRIORITY_RECORD": abi.PRIORITY_RECORD,
    "V4L2_CTRL_FLAG_NEXT_CTRL": abi.NEXT_CONTROL,
    "V4L2_EXPOSURE_MANUAL": 1,
    "V4L2_FIELD_NONE": 1,
}


def program() -> str:
    lines = [f'P("{name}", sizeof(struct {name}));' for name in STRUCTURES]
    lines += [f'P("{name}.{member}", offsetof(struct {name}, {member}));' for name, member in MEMBERS]
    lines += [f'P("{name}", {name});' for name in CONSTANTS]
    return "\n".join(
        [
            "#include <stdio.h>",
            "#include <stddef.h>",
            "#include <linux/videodev2.h>",
            '#define P(name, value) printf("%s %llu\\n", name, (unsigned long long)(value) & 0xffffffffull)',
            "int main(void) {",
            *lines,
            "return 0; }",
        ]
    )


def test_structures_and_constants_are_those_of_the_kernels_header(tmp_path: Path) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not Path("/usr/include/linux/videodev2.h").exists():
        pytest.skip("no C compiler, or no linux/videodev2.h (Debian: linux-libc-dev)")
    source, built = tmp_path / "sizes.c", tmp_path / "sizes"
    source.write_text(program())
    subprocess.run([compiler, "-o", str(built), str(source)], check=True, timeout=60)
    answer = subprocess.run([str(built)], check=True, capture_output=True, text=True, timeout=60).stdout
    of_c = {name: int(value) for name, value in (line.split() for line in answer.splitlines())}
    ours = {name: ctypes.sizeof(structure) for name, structure in STRUCTURES.items()}
    ours |= {f"{name}.{member}": field.offset for (name, member), field in MEMBERS.items()}
    ours |= {name: int(value) for name, value in CONSTANTS.items()}
    assert ours == of_c


def test_a_code_reads_as_it_was_written() -> None:
    assert [abi.code_of(abi.fourcc(code)) for code in ("GREY", "Y10", "YUYV")] == ["GREY", "Y10", "YUYV"]
