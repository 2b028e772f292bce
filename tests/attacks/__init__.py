"""Files and folders that a colleague could send: none may run code, hang, lie or lose anything.

The quick part runs with the suite; `make attack` runs the same at length.
"""
