"""The agent file (ONNX): its content, its checks, and the sandbox in which it is played.

Learning algorithms belong in ``train``, one file each.
"""
