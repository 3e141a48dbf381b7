"""The Command Center (Textual): the status of every module, a log view, and the operator's stop and commands."""
