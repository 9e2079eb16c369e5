"""Frames of environments at work, drawn with Pillow and, for ``render_mode="human"``, shown in a window with pygame.

Rendering only looks on: it changes no environment and draws none of its random numbers. What is hidden from the policy, the true
hardness and allowance along the bar, is drawn too, but faintly. Rules that decide what happens do not belong here.
"""
