"""Merge the limits of protocol, rig file and opened devices. The narrowest limit of a quantity applies."""

from collections.abc import Iterable

from rig.facts import RigFacts
from rig.limit_settings import RigLimits
from rig.limits.stiffness import LoadStringBounds
from rig.limits.table import Bound, Limit, LimitTable
from rig.protocol.protocol import Protocol
from rig.protocol.step import ProtocolStep
from rig.protocol.tables import Limits


def limit_table(
    protocol: Protocol, facts: RigFacts, rig: RigLimits, string: LoadStringBounds | None
) -> LimitTable:
    """Return the merged limits for a protocol on a rig.

    `facts` has the limits of load frame, stage and interlocks, from the rig file or from the opened devices.
    `rig` is the table [limits] of the rig file. `string` is the plausible behaviour of specimen, grips and
    load frame in a tension test.
    """
    both = [
        ("load", "N", "load_min_n", "load_max_n"),
        ("displacement", "mm", "displacement_min_mm", "displacement_max_mm"),
    ]
    up = [("speed", "mm/s", "speed_max_mm_s"), ("load rate", "N/s", "load_rate_max_n_s")]
    limits: list[Limit] = []
    declared, devices = protocol.conditions.limits, protocol.conditions.devices
    if declared is not None:
        for quantity, unit, least, greatest in both:
            limits.append(_declared(quantity, unit, declared, least, greatest))
            limits.append(_both_ways(quantity, unit, getattr(rig, greatest), f"the rig's limits.{greatest}"))
            limits.append(_range(quantity, unit, facts, "the rig's load_frame", least, greatest))
        for quantity, unit, key in up:
            limits.append(_up(quantity, unit, getattr(rig, key), f"the rig's limits.{key}"))
            limits.append(_up(quantity, unit, getattr(facts, key), f"the rig's load_frame.{key}"))
        if string is not None:
            limits += _plausible(string)
    if "stage" in devices:
        for values, where in ((rig, "the rig's limits"), (facts, "the rig's stage")):
            limits.append(_range("angle", "deg", values, where, "angle_min_deg", "angle_max_deg"))
    for each in facts.interlocks:
        where = f"the rig's interlocks.{each.name}"
        limits.append(_range(f"interlock {each.name}", each.unit, each, where, "allowed_min", "allowed_max"))
    return LimitTable(limits)


def table_objections(protocol: Protocol, table: LimitTable) -> list[str]:
    """Return one sentence for each planned motion that exceeds a limit."""
    steps = [step for step in protocol.steps() if step.begins]
    wishes = [(*wish, str(step)) for step in steps for wish in commanded(step)]
    if "stage" in protocol.conditions.devices:
        wishes.append(("angle", 0.0, "the reference"))
    found: dict[str, str] = {}
    for quantity, value, name in wishes:
        limit = table.get(quantity)
        bound = None if limit is None else limit.beyond(value)
        if limit is not None and bound is not None:
            found.setdefault(
                quantity,
                f"{name} asks for a {quantity} of {value:g} {limit.unit}, but {bound.source} is "
                f"{bound.value:g}; change one of them",
            )
    return list(found.values())


def commanded(step: ProtocolStep) -> list[tuple[str, float]]:
    """Return the quantities that a step commands, with their values."""
    if step.quantity == "load":
        return [("load", step.target), ("load rate", step.rate)]
    if step.quantity == "displacement" and step.kind == "displacement":
        return [("displacement", step.target), ("speed", step.rate)]
    return [("angle", step.target)] if step.quantity == "rotation" else []


def _plausible(string: LoadStringBounds) -> Iterable[Limit]:
    yield Limit(
        "stiffness",
        "N/mm",
        Bound(string.stiffness_min_n_mm, "plausible: modulus and machine stiffness"),
        Bound(string.stiffness_max_n_mm, "plausible: modulus and machine stiffness"),
    )
    yield _up("speed in increments of load", "mm/s", string.speed_max_mm_s, "plausible.speed_max_mm_s")


def _declared(quantity: str, unit: str, declared: Limits, least: str, greatest: str) -> Limit:
    """Return a limit of the protocol. Without a lower limit, the upper one applies in both directions."""
    if getattr(declared, least) is None:
        return _both_ways(quantity, unit, getattr(declared, greatest), f"limits.{greatest}")
    return _range(quantity, unit, declared, "limits", least, greatest)


def _both_ways(quantity: str, unit: str, greatest: float | None, source: str) -> Limit:
    least = None if greatest is None else -greatest
    return Limit(quantity, unit, _bound(least, source), _bound(greatest, source))


def _range(quantity: str, unit: str, values: object, where: str, least: str, greatest: str) -> Limit:
    """Return the limit whose bounds are two attributes of `values`. `where` is the table that sets them."""
    low = _bound(getattr(values, least), f"{where}.{least}")
    return Limit(quantity, unit, low, _bound(getattr(values, greatest), f"{where}.{greatest}"))


def _up(quantity: str, unit: str, greatest: float | None, source: str) -> Limit:
    return Limit(quantity, unit, None, _bound(greatest, source))


def _bound(value: float | None, source: str) -> Bound | None:
    return None if value is None else Bound(value, source)
