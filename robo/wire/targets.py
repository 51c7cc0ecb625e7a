"""Whom a query asks: `session.get(key, **OF_ALL)`."""

from typing import Any

import zenoh

OF_ONE: dict[str, Any] = {"target": zenoh.QueryTarget.ALL_COMPLETE, "consolidation": zenoh.ConsolidationMode.NONE}
"""Of a query for one answer: from all that say they have it, the first as it comes."""

OF_ALL: dict[str, Any] = {"target": zenoh.QueryTarget.ALL, "consolidation": zenoh.ConsolidationMode.NONE}
"""Of a query for every answer: from whoever has one, and none in the place of another."""
