"""What commands are made with: click commands out of functions, help screens, late imports.

It knows no command. Importing it costs click alone: rich is loaded when something is shown.
"""
