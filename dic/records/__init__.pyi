from .joining import JoinedRecord as JoinedRecord
from .machine import (
    MachineRecord as MachineRecord,
    read_image_times as read_image_times,
    read_machine_record as read_machine_record,
)
