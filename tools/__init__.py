"""Programs for maintainers: soak, wheel, clients, audit, density."""
