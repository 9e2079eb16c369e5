"""Research beside the benchmark: the five papers checked, studies of policies and speed, and the JOSS paper.

Code that users or other packages call belongs elsewhere.
"""
