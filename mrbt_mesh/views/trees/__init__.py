"""Trees as people see them: drawn, checked, converted; `mrbt tree`."""
