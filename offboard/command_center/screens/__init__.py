"""The screens: the main one, the modals that ask before something happens, the help. Each carries the stop bar."""
