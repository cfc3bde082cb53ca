"""How far specimens usually shift towards the camera, which one camera cannot see."""

from typing import get_args

from dic.runfile.schema import FixedFace

SHIFT_STD_UM = 30.0
"""Default standard deviation of the specimen's shift towards the camera since the reference, µm.

One camera cannot see the shift. A specimen that seats itself in its grips moves by tens of micrometres.
"""

TRAVEL_SHARE = 0.02
"""Default standard deviation of the further shift, divided by the travel of the specimen in its plane.

The direction in which the grips travel deviates by about 1° from the grid's plane.
"""

GRIP_MM = 30.0
"""Assumed distance of the field from the grip that stands still, which gives the travel by strain, mm."""

FACES = get_args(FixedFace)
"""The parts of a specimen that the grips may hold in place while it becomes thinner."""

THICKEST_MM = 100.0

HINGE_STD_UM = 5.0
"""Default standard deviation of the shift that a tilt about a known hinge does not explain, µm.

The play of a loaded pin is a few micrometres. If the position of the hinge is wrong by 2 mm, the computed
shift for a tilt of 0.1° is wrong by 3.5 µm.
"""

FARTHEST_MM = 1e4
"""Largest distance of the hinge from the grid's centre."""
