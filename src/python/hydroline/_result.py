"""What every result of a function has: the JSON of its command, its remarks, its report."""

from __future__ import annotations

import html
import json
from typing import Any, Dict, Mapping, Optional, Tuple

from . import _hydroline


class Result:
    """A result: what the command line prints with ``--json``, and its remarks."""

    def __init__(self, called: "_hydroline.Called") -> None:
        self._called = called
        self._dict: Optional[Dict[str, Any]] = None

    @property
    def json(self) -> str:
        """The text that the command line prints with ``--json``, byte for byte."""
        return self._called.text

    @property
    def remarks(self) -> Tuple[str, ...]:
        """Remarks for a person, which the command line prints on stderr."""
        return tuple(self._called.remarks)

    @property
    def lossy(self) -> bool:
        """Whether something was lost on the way (exit code 3)."""
        return self._called.lossy

    def to_dict(self) -> Dict[str, Any]:
        """The command line's JSON as a dictionary, made anew at each call: it may be changed."""
        made: Dict[str, Any] = json.loads(self.json)
        return made

    @property
    def _fields(self) -> Mapping[str, Any]:
        if self._dict is None:
            self._dict = self.to_dict()
        return self._dict

    def _sentence(self) -> str:
        return f"{len(self._fields)} fields"

    def __repr__(self) -> str:
        return f"<hydroline.{type(self).__name__}: {self._sentence()}>"

    def _repr_html_(self) -> Optional[str]:
        """The report in a frame of its own, as ``--report`` writes it; None where the command has none."""
        page = self._called.page()
        if page is None:
            return None
        # A frame, so that the report's styles and the notebook's know nothing of each other.
        text = html.escape(page, quote=True)
        return f'<iframe srcdoc="{text}" width="100%" height="640" style="border:0"></iframe>'
