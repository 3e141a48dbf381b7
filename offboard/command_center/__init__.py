"""The Command Center (Textual): what every module says, a log view, and the operator's stop and commands."""
