"""The HTTP service and its review pages. It knows nothing of the mathematics; `inhalemon` never imports it."""
