"""Interfaces to the devices of a test rig, one interface per kind of device, and the search for drivers.

This package exports all public names. A name is loaded when it is first used:

>>> import drivers
>>> drivers.find_driver("zaber-ascii").kind
'stage'

To add your own driver, implement `Camera`, `RotationStage`, `LoadFrame`, `Interlock` or `Operator`, and
publish the driver as a `DriverSpec`. The package `drivers.testing` has the tests that every driver must pass.
A driver raises a `DeviceError` if its device does not execute a command. The error message is one sentence
that ends with the remedy.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
