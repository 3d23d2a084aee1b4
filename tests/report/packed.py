"""What a page carries packed, as its script unpacks it."""

from __future__ import annotations

import base64
import json
import re
import zlib
from typing import Any

PLAIN = str.maketrans(",.:", "<>&")


def unpacked(page: str, name: str) -> str:
    """The text of a packed script element."""
    found = re.search(f'id="{name}">(.*?)</script>', page, re.S)
    assert found is not None
    return zlib.decompress(base64.b85decode(found.group(1).translate(PLAIN))).decode()


def drawn(page: str) -> dict[str, Any]:
    """Figures by their place, arrays by number, template and colours."""
    return json.loads(unpacked(page, "drawn"))


def without_scripts(page: str) -> str:
    """What a page says in words."""
    return re.sub(r"<script.*?</script>", "", page, flags=re.S)
