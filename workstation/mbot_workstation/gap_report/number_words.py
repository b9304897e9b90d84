"""Numbers as the page writes them."""

import math


def metres(value_m: float) -> str:
    """Such as 4 mm, 3.2 cm or 1.31 m."""
    if value_m < 0.01:
        return f"{value_m * 1000:.1f} mm"
    return f"{value_m * 100:.1f} cm" if value_m < 1 else f"{value_m:.2f} m"


def degrees(value_rad: float) -> str:
    """Such as 0.8° or 123°."""
    value = math.degrees(value_rad)
    return f"{value:.1f}°" if value < 10 else f"{value:.0f}°"


def percent(share: float | None) -> str:
    """Such as 0.31 % or 12 %."""
    if share is None:
        return "not known"
    value = 100 * share
    return f"{value:.0f} %" if value >= 10 else f"{value:.1f} %" if value >= 1 else f"{value:.2f} %"


def seconds(value_s: float) -> str:
    """Such as 10 s."""
    return f"{value_s:.3g} s"
