"""Research beside the benchmark.

Here are checks of the five papers, studies of policies and speed, and the JOSS paper.

Code that users or other packages call belongs elsewhere.
"""
