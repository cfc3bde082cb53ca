"""How far specimens usually shift towards the camera, which one camera cannot see."""

SHIFT_STD_UM = 30.0
"""Default standard deviation of the specimen's shift towards the camera since the reference, µm.

One camera cannot see the shift. Grips and load trains move specimens by tens of micrometres.
"""

HINGE_STD_UM = 5.0
"""Default standard deviation of the shift that a tilt about a known hinge does not explain, µm.

The play of a loaded pin is a few micrometres. If the position of the hinge is wrong by 2 mm, the computed
shift for a tilt of 0.1° is wrong by 3.5 µm.
"""

FARTHEST_MM = 1e4
"""Largest distance of the hinge from the grid's centre."""
