"""A line that a person types into."""

from __future__ import annotations

from typing import ClassVar

from textual import events
from textual.binding import Binding
from textual.widgets import Input


class Field(Input):
    """Its keys take effect in the order in which they come.

    Textual inserts a character here at once, but leaves backspace, enter and the like to the app, at the end of a row
    of queues: under load the characters that follow would overtake them.
    """

    _ACTIONS: ClassVar[dict[str, str]] = {key.key: key.action for key in Binding.make_bindings(Input.BINDINGS)}

    async def _on_key(self, event: events.Key) -> None:
        action = self._ACTIONS.get(event.key)
        if action is None:
            await super()._on_key(event)
            return
        event.stop()
        event.prevent_default()
        await self.run_action(action)
