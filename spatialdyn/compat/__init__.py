"""The library under other libraries' names and conventions."""
