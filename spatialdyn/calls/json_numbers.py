"""Results as JSON, which has no number that is not finite."""

from __future__ import annotations

import json
import math
from typing import Any


def finite_or_none(x: Any) -> Any:
    """None for a float that is not finite; anything else as it is."""
    return None if isinstance(x, float) and not math.isfinite(x) else x


def json_text(x: Any) -> str:
    """Indented JSON. Raises ValueError for a number that is not finite."""
    return json.dumps(x, indent=2, ensure_ascii=False, allow_nan=False)
