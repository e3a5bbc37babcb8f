"""Command line: reduce a mesh to a body file, look into one, estimate an impact, check the installation."""

from .commands import main as main
