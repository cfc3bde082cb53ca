"""Settings of the news of a run: the table ``[news]`` of a rig file."""

from pydantic import Field

from drivers.settings import Settings


class NewsSettings(Settings):
    """The message at the end of a run, and the HTTP interface. The two news files need no setting."""

    # command that is called once at the end of a run, with the message on its standard input
    notify: str | None = Field(default=None, min_length=1, max_length=4000)
    notify_timeout_s: float = Field(default=30.0, gt=0.0, le=600.0)  # longest time for that command
    # port on this computer at which the HTTP interface answers during a run. With 0 it is any free port.
    http: int | None = Field(default=None, ge=0, le=65535)
