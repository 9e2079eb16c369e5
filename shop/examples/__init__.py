"""Programs that use the workshop: adapt every example program, measure its speed, fit measured data."""
