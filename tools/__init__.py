"""Programs for maintainers: soak, wheel, clients."""
