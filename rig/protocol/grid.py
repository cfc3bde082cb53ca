"""The table `[grid]` of a protocol: the calibration target that the operator attaches to the specimen."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag, model_validator

from dic.runfile.schema import GridMaking
from drivers.settings import Settings

# Dot finding needs at least this number of dots to recognise a shifted lattice.
_FEWEST_SHIFTED = 16


class _Target(Settings):
    grid_made: GridMaking | None = Field(default=None, description="how the target was made")
    scale_ratio_std: float | None = Field(
        default=None,
        ge=0.0,
        le=0.05,
        description="standard deviation of the ratio of its scales along X and Y",
    )
    skew_std: float | None = Field(
        default=None, ge=0.0, le=0.05, description="standard deviation of the angle between its axes, rad"
    )
    flatness_std_mm: float | None = Field(
        default=None, ge=0.0, le=1.0, description="standard deviation of the height of a bow at its edge"
    )

    @property
    def counts(self) -> tuple[int, int]:
        """Number of lines, squares or dots of the calibration target along X and along Y."""
        x, y = (value for name, value in self if name.endswith(("_x", "_y")))
        return x, y


class Grid(_Target):
    """The calibration grid of lines. The default is the paper's grid, 10 mm x 10 mm."""

    target: Literal["lines"] = "lines"
    lines_x: int = Field(default=21, ge=4, le=1000, description="number of lines crossed on a path along X")
    lines_y: int = Field(default=21, ge=4, le=1000, description="number of lines crossed on a path along Y")
    pitch_mm: float = Field(default=0.5, gt=0.0, description="distance between neighbouring lines")


class CheckerboardGrid(_Target):
    """A checkerboard of dark and bright squares."""

    target: Literal["checkerboard"]
    squares_x: int = Field(ge=5, le=1000, description="number of whole squares along X")
    squares_y: int = Field(ge=5, le=1000, description="number of whole squares along Y")
    pitch_mm: float = Field(gt=0.0, description="length of the side of a square")


class CharucoGrid(CheckerboardGrid):
    """A checkerboard with ArUco markers in its bright squares."""

    target: Literal["charuco"]  # type: ignore[assignment]
    squares_x: int = Field(ge=3, le=1000, description="number of whole squares along X")
    squares_y: int = Field(ge=3, le=1000, description="number of whole squares along Y")
    marker_mm: float = Field(gt=0.0, description="length of the side of a marker")
    dictionary: str = Field(default="DICT_5X5_100", pattern=r"^DICT_[A-Z0-9_]+$")

    @model_validator(mode="after")
    def _markers_fit(self) -> "CharucoGrid":
        if self.marker_mm >= self.pitch_mm:
            raise ValueError(f"marker_mm must be below pitch_mm, {self.pitch_mm:g}, got {self.marker_mm:g}")
        return self


class DotGrid(_Target):
    """Round dots on a square lattice."""

    target: Literal["dots"]
    dots_x: int = Field(ge=5, le=1000, description="number of dots along X")
    dots_y: int = Field(ge=5, le=1000, description="number of dots along Y")
    pitch_mm: float = Field(gt=0.0, description="distance between the centres of neighbouring dots")


class AsymmetricDotGrid(_Target):
    """Round dots in rows, every second row shifted by half a pitch. X points along the rows."""

    target: Literal["asymmetric-dots"]
    dots_x: int = Field(ge=3, le=1000, description="number of dots in each row")
    dots_y: int = Field(ge=4, le=1000, description="number of rows")
    pitch_mm: float = Field(
        gt=0.0, description="distance between neighbouring dots of a row, twice the distance between rows"
    )

    @model_validator(mode="after")
    def _enough_dots(self) -> "AsymmetricDotGrid":
        if self.dots_x * self.dots_y < _FEWEST_SHIFTED:
            got = f"{self.dots_x} × {self.dots_y}"
            raise ValueError(f"dots_x × dots_y must be at least {_FEWEST_SHIFTED} dots, got {got}")
        return self


AnyGrid: TypeAlias = Grid | CheckerboardGrid | CharucoGrid | DotGrid | AsymmetricDotGrid


def _target(table: Any) -> Any:
    # A table without the key `target` is a line grid, because protocols of earlier programs lack this key.
    return table.get("target", "lines") if isinstance(table, dict) else getattr(table, "target", None)


GridTable: TypeAlias = Annotated[
    Annotated[Grid, Tag("lines")]
    | Annotated[CheckerboardGrid, Tag("checkerboard")]
    | Annotated[CharucoGrid, Tag("charuco")]
    | Annotated[DotGrid, Tag("dots")]
    | Annotated[AsymmetricDotGrid, Tag("asymmetric-dots")],
    Discriminator(
        _target,
        custom_error_type="unknown_target",
        custom_error_message=(
            "target: 'lines', 'checkerboard', 'charuco', 'dots' or 'asymmetric-dots' is expected"
        ),
    ),
]
