"""Record loads, speeds, overrides and positions of a machine, and turn the record into a sheet.

Nothing in this folder writes to a machine, calls a method of it or commands it: sources browse and
read. Controlling a machine belongs in the modules beside this folder.
"""
