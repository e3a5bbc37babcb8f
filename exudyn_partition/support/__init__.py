"""Tools of no theory: checks of arguments, files, the cache, progress, interruption and optional packages."""
