"""Get the mistakes that a driver's settings model finds in a table of a rig file."""

from typing import Any

import pytest
from pydantic import ValidationError

from drivers.settings import Settings, mistakes_in


def mistakes_of(model: type[Settings], table: dict[str, Any]) -> list[str]:
    """Return the mistakes for which a table is refused."""
    with pytest.raises(ValidationError) as refused:
        model.model_validate(table)
    return mistakes_in(refused.value)
