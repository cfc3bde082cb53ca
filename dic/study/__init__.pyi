from .plot import plot_study as plot_study
from .result import (
    StudiedSettings as StudiedSettings,
    Study as Study,
)
from .study import study_settings as study_settings
from .sweep import Sweep as Sweep
from .wave import Wave as Wave
