"""Every figure that README and docs quote, measured beside its peers in one run: `make validate`."""
