"""Files that run in FreeCAD's Python, with nothing of this project around them."""
