"""``bag record``: `record` runs it, `selection` chooses topics, `recorder` receives, `writer` writes."""
