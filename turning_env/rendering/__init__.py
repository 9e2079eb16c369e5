"""Frames of environments at work, drawn with Pillow and, for ``render_mode="human"``, shown in a window with pygame.

``plot_style`` styles all figures that are drawn with Matplotlib.

Rendering changes no environment and uses none of its random numbers. Frames also show quantities that are hidden from the policy,
the true hardness and allowance along the bar, but faintly. Equations of the process do not belong here.
"""
