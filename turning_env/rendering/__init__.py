"""Frames of environments at work, drawn with Pillow, and a window that shows them with pygame.

``plot_style`` styles all figures that are drawn with Matplotlib.

Rendering changes no environment and uses none of its random numbers. Frames also show quantities
that are hidden from the policy, the true hardness and allowance along the bar, but faintly.
Equations of the process do not belong here.
"""
