from .reader import (
    RunInfo as RunInfo,
    RunStep as RunStep,
)
