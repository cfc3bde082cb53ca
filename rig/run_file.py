"""The reader of run files, which is a part of `dic`."""

from dic.errors import RunFileError
from dic.runfile.interlocks import RunInterlock
from dic.runfile.reader import RunFile, RunInfo, RunStep

__all__ = ["RunFile", "RunFileError", "RunInfo", "RunInterlock", "RunStep"]
