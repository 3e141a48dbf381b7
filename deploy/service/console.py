"""Input and output of a service tool: a prompt, and lines for the person beside the robot."""

from __future__ import annotations

from collections.abc import Callable

Prompt = Callable[[str], str]  # shows a question, returns the line that was typed
Output = Callable[[str], None]  # shows a line
