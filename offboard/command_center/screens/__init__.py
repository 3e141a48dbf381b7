"""The screens: the main one, the dialogs that confirm a command, the help. Each carries the stop bar."""
