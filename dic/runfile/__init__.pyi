from .at_exposure import (
    ExposedSteps as ExposedSteps,
    steps_at_exposure as steps_at_exposure,
)
from .reader import (
    RunInfo as RunInfo,
    RunStep as RunStep,
)
from .steps import ChannelValue as ChannelValue
