"""Which version of robo this is: here, since to ask the installed packages takes longer than to import robo."""

VERSION = "0.1.0"
