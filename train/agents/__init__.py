"""The agent file (ONNX): what it holds, how it is checked, and how it is played in a sandbox.

How an agent learns belongs in ``train``, one file per algorithm.
"""
