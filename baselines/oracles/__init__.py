"""Oracles and bounds: what a policy could earn that knows what no control measures.

They are shown beside the policies and are not ranked.
"""
